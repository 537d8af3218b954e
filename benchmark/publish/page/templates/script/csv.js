// CSV: the files that the page holds, parsed when they are first needed.
import { csv } from "./data.js";

const parsed = new Map();

export const holds = (file) => file in csv;

// The rows of a file that the page holds; the first has the names of its columns.
export function rowsOf(file) {
  if (!parsed.has(file)) parsed.set(file, parse(csv[file]));
  return parsed.get(file);
}

function parse(text) {
  const rows = [[]];
  for (const [, quoted, plain, end] of text.matchAll(/(?:"((?:[^"]|"")*)"|([^",\n]*))(,|\n|$)/g)) {
    rows.at(-1).push(quoted === undefined ? plain : quoted.replaceAll('""', '"'));
    if (end === "\n") rows.push([]);
    if (end === "") break;
  }
  return rows.filter((row) => row.length > 1 || row[0] !== "");
}
