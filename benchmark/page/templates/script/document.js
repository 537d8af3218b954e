// The document as a whole: tells the style sheet that scripts run, and follows a link to the explorer before the rest
// has been unpacked.
document.documentElement.classList.add("js");
if (location.hash.startsWith("#explorer=")) document.getElementById("explorer")?.scrollIntoView({ behavior: "instant" });
