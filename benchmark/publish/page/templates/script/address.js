// The address: the page's fragment says what the explorer shows, so that it can be cited and shared.
const START = "#explorer=";
const KEYS = ["scenario", "variant", "observation", "experiment", "seed", "block"]; // of an agent and its map
const escaped = (text) => encodeURIComponent(text).replaceAll(".", "%2E").replaceAll("~", "%7E");

function unescaped(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return ""; // a mistyped address
  }
}

function wishOf(text = "") {
  const parts = text.split(".").map(unescaped);
  return Object.fromEntries(KEYS.map((key, i) => [key, parts[i]]));
}

// What the address asks for, or null; nothing of it need exist.
export function asked() {
  if (!location.hash.startsWith(START)) return null;
  const [left, right, step, kind] = location.hash.slice(START.length).split("~"); // older ones name no seeds or blocks
  return { wishes: [wishOf(left), wishOf(right)], step: Number(step), kind };
}

export function addressOf(panels, { step, kind }) {
  const named = panels.map(({ agent, block }) => KEYS.map((key) => escaped({ ...agent, block }[key])).join("."));
  return START + [...named, step, kind].join("~");
}
