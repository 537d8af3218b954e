// The page's data: the text of CSV files by their links, and what the explorer shows (null if nothing).
import { byId } from "./elements.js";

export const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));

const json = new Blob([bytes(byId("data").textContent)]).stream().pipeThrough(new DecompressionStream("gzip"));
export const { explorer, csv } = await new Response(json).json();
