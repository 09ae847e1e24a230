// What scrolls by itself can be reached with the keyboard, the dialog of the search has a name, and sentences in tables room.
const SCROLLS = ".md-typeset__scrollwrap:not([tabindex]), pre > code:not([tabindex]), math[display=block]:not([tabindex])";
const LONG = 45; // characters
const name = () => {
  document.querySelectorAll(SCROLLS).forEach(element => { element.tabIndex = 0; });
  document.querySelectorAll("td:not(.long)").forEach(cell => { if (cell.textContent.length > LONG) cell.classList.add("long"); });
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
};
new MutationObserver(name).observe(document.body, { childList: true, subtree: true }); // tables are wrapped by a script
name();
