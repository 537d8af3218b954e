// The key: what the signs on the maps mean.
import { byId, drawn, element } from "./elements.js";
import { explorer } from "./data.js";
import { agents } from "./agents.js";
import { INDIFFERENT } from "./colours.js";
import { dotted, GLYPHS, hatched, outlined, walker } from "./scene.js";

const NAMES = { issuer: "person (with a nose where it matters where they look)", bystander: "bystander", onlooker: "onlooker (does not matter)", start: "start" };
const frame = { x: 3, y: 3, width: 18, height: 18 };
const dark = () => drawn("rect", { width: 24, height: 24, fill: "#575d6d" });

export function paintKey() {
  const glyphs = new Set(explorer.rooms.flatMap((room) => room.views[0].glyphs.map((glyph) => glyph.kind)));
  const outlines = new Map(explorer.rooms.flatMap((room) => room.outlines));
  const signs = [
    ...[...glyphs].map((kind) => [GLYPHS[kind](12, 12, 0.8), NAMES[kind]]),
    ...(explorer.rooms.some((room) => room.views[0].circle) ? [[dotted(12, 12, 9), "circle on which people talk"]] : []),
    ...[...outlines].map(([label, dashed]) => [outlined("rect", frame, dashed), label]),
    [[dark(), drawn("path", { d: "M4,12L19,12M14,7L19,12L14,17", stroke: "#fff", "stroke-width": 2.4, fill: "none" })], "greedy move"],
    [[dark(), drawn("circle", { cx: 12, cy: 12, r: 5, fill: "#fff", stroke: "#000" })], "greedy PING"],
    [
      [drawn("rect", { ...frame, fill: INDIFFERENT, stroke: "#767d84" }), drawn("path", { class: "hatch", d: hatched(12, 12, 9) })],
      "no preference: all actions have the same value, as in a row of a table that was never updated",
    ],
    ...(explorer.rooms.some((room) => room.walls.length) ? [[[drawn("rect", { ...frame, fill: explorer.palette.wall })], "wall"]] : []),
    [[walker(12, 12)], "agent and its path"],
    [[drawn("rect", { ...frame, class: "cursor" })], "cell whose numbers are shown"],
  ];
  if (agents.some((agent) => agent.hasValues && agent.values.some(Number.isNaN))) {
    signs.push([[drawn("rect", { ...frame, fill: explorer.palette["no value"], stroke: "#000" })], "no value: the net has diverged"]);
  }
  const sign = (shapes) => drawn("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, ...shapes);
  byId("key").replaceChildren(...signs.map(([shapes, text]) => element("li", {}, sign(shapes), text)));
}
