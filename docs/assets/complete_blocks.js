// The copy button of a code block copies a program that runs alone: the block after the lines of
// earlier blocks that it needs, which the build of the manual attaches to it.
document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-clipboard-target]");
  const block = button?.closest("[data-complete]");
  if (block) button.setAttribute("data-clipboard-text", block.dataset.complete);
}, true);
