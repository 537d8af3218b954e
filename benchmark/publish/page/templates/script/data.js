// The page's data: the text of CSV files by their links, and what the explorer shows (null if nothing).
import { byId } from "./elements.js";
import { Room } from "./room.js";

function unzipped(node) {
  const zipped = new Blob([Uint8Array.from(atob(node.textContent), (letter) => letter.charCodeAt(0))]);
  return new Response(zipped.stream().pipeThrough(new DecompressionStream("gzip"))).json();
}

// The running sums of changes.
function summed(changes) {
  let sum = 0;
  return Int32Array.from(changes, (change) => (sum += change));
}

const unzippedCsv = unzipped(byId("data"));
const parts = await Promise.all([...document.querySelectorAll("script.agents")].map(async (node) => {
  const part = await unzipped(node);
  const { experiment, folder } = node.dataset;
  const rooms = part.scenes.map((packed) => new Room(packed));
  const sights = part.sights.map(({ observed, changes }) => ({ observed, of: summed(changes) }));
  const linked = (agent) => ({ ...agent, room: rooms[agent.scene], sight: sights[agent.sight], experiment, folder });
  return { ...part, rooms, agents: part.agents.map(linked) };
}));

export const csv = await unzippedCsv;
// The agents and rooms of all experiments, concatenated; everything else is the same.
const all = (key) => parts.flatMap((part) => part[key]);
export const explorer = parts.length ? { ...parts[0], agents: all("agents"), rooms: all("rooms") } : null;
