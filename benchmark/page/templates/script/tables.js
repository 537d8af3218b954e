// Tables: a click on a column's header sorts by it, upwards, downwards, then as written.
import { element } from "./elements.js";

for (const sortable of document.querySelectorAll("table.sortable")) {
  const body = sortable.tBodies[0];
  const written = [...body.rows];
  const heads = [...sortable.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = element("button", { type: "button" }, head.textContent);
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")] ?? "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      if (next === "none") return body.append(...written);
      head.setAttribute("aria-sort", next);
      const sign = next === "ascending" ? 1 : -1;
      body.append(...[...written].sort((a, b) => compared(a.cells[column], b.cells[column], sign)));
    });
  });
}

// The number that a cell begins with, NaN without one.
function numberOf(cell) {
  const text = cell.textContent.trim().replaceAll("\u2212", "-").replaceAll(",", "");
  return text === "never" ? Infinity : parseFloat(text);
}

function compared(a, b, sign) {
  if (!a.matches(".number")) return sign * a.textContent.localeCompare(b.textContent);
  const [x, y] = [numberOf(a), numberOf(b)];
  if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y); // missing numbers come last
  return x === y ? 0 : sign * (x < y ? -1 : 1);
}
