// Elements and formatting: makes HTML and SVG nodes, and writes numbers as readers see them.
const byId = (id) => document.getElementById(id);
const element = (name, attributes = {}, ...children) => filled(document.createElement(name), attributes, children);
const drawn = (name, attributes = {}, ...children) =>
  filled(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// Two shapes on top of each other: a light line with a dark border can be seen on any colour.
function bordered(name, attributes, width, border) {
  const { "stroke-dasharray": _, ...solid } = attributes;
  return [
    drawn(name, { ...solid, fill: "none", stroke: "#000", "stroke-width": border }),
    drawn(name, { ...attributes, fill: "none", stroke: "#fff", "stroke-width": width }),
  ];
}

function show(value, digits = 3) {
  if (value === null || Number.isNaN(value)) return "none";
  return (+value.toFixed(digits)).toString().replace("-", "\u2212");
}

const grouped = (value) => value.toLocaleString("en-GB");
const range = (count) => Array.from({ length: count }, (_, i) => i);

function select(menu, options, value) {
  menu.replaceChildren(...options.map(([key, text]) => element("option", { value: key }, text)));
  menu.value = value;
}
