// Elements and formatting: makes HTML and SVG nodes, and writes numbers as readers see them.
const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

export function element(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

export function drawn(name, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, name), attributes, children);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// Two shapes on top of each other: a light line with a dark border can be seen on any colour.
export function bordered(name, attributes, width, border) {
  const shared = { ...attributes, fill: "none", "pointer-events": "none" };
  const { "stroke-dasharray": _, ...solid } = shared;
  return [
    drawn(name, { ...solid, stroke: "#000", "stroke-width": border }),
    drawn(name, { ...shared, stroke: "#fff", "stroke-width": width }),
  ];
}

export function show(value, digits = 3) {
  if (value === null || Number.isNaN(value)) return "none";
  return (+value.toFixed(digits)).toString().replace("-", "\u2212");
}

export const grouped = (value) => value.toLocaleString("en-GB");

// A number that links to the line of the file that it comes from.
export const sourced = (file, line, text) => element("a", { class: "n", href: `${file}#row=${line}` }, text);
