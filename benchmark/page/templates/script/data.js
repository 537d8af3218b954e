// The page's data: the text of CSV files by their links, and what the explorer shows (null if nothing).
import { byId } from "./elements.js";

export const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));

function unzipped(node) {
  const zipped = new Blob([bytes(node.textContent)]);
  return new Response(zipped.stream().pipeThrough(new DecompressionStream("gzip"))).json();
}

export const csv = await unzipped(byId("data"));
const parts = await Promise.all([...document.querySelectorAll("script.agents")].map(async (node) => {
  const part = await unzipped(node);
  const { experiment, folder } = node.dataset;
  const linked = (agent) => ({ scene: part.scenes[agent.scene], optimum: part.optima[agent.optimum] });
  return { ...part, agents: part.agents.map((agent) => ({ ...agent, ...linked(agent), experiment, folder })) };
}));

// Of several experiments, the agents, scenes and optima one after the other; all else is the same.
const all = (key) => parts.flatMap((part) => part[key]);
export const explorer = parts.length
  ? { ...parts[0], agents: all("agents"), scenes: all("scenes"), optima: all("optima") }
  : null;
