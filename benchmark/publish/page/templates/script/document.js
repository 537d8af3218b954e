// The document as a whole: tells the style sheet that scripts run and which figures are wider than the screen, and
// follows a link to the explorer before the rest has been unpacked.
document.documentElement.classList.add("js");
if (location.hash.startsWith("#explorer=")) document.getElementById("explorer")?.scrollIntoView({ behavior: "instant" });

// Marks the boxes of figures that are wider than the screen.
const sizes = new ResizeObserver((changed) => {
  for (const { target } of changed) target.classList.toggle("cut", target.scrollWidth > target.clientWidth);
});
for (const box of document.querySelectorAll("figure > .scroll")) sizes.observe(box);
