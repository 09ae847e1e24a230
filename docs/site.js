// What scrolls by itself can be reached with the keyboard, and the dialog of the search has a name.
const SCROLLS = ".md-typeset__scrollwrap:not([tabindex]), pre > code:not([tabindex]), math[display=block]:not([tabindex])";
const name = () => {
  document.querySelectorAll(SCROLLS).forEach(element => { element.tabIndex = 0; });
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
};
new MutationObserver(name).observe(document.body, { childList: true, subtree: true }); // tables are wrapped by a script
name();
