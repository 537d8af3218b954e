// The document as a whole: tells the style sheet that scripts run, follows a link to the explorer before the rest has
// been unpacked, and unfolds folded parts for printing.
document.documentElement.classList.add("js");
if (location.hash.startsWith("#explorer=")) document.getElementById("explorer")?.scrollIntoView({ behavior: "instant" });

addEventListener("beforeprint", () => {
  for (const folded of document.querySelectorAll("details:not([open])")) {
    folded.setAttribute("open", "");
    folded.setAttribute("data-folded", "");
  }
});
addEventListener("afterprint", () => {
  for (const unfolded of document.querySelectorAll("[data-folded]")) {
    unfolded.removeAttribute("open");
    unfolded.removeAttribute("data-folded");
  }
});
