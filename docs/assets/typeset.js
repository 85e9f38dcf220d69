// Typesets the equations of a page. KaTeX lies beside this file: the manual needs no network.
document.addEventListener("DOMContentLoaded", () => {
  for (const element of document.querySelectorAll(".arithmatex")) {
    // The extension pymdownx.arithmatex wraps inline mathematics in \( \), displays in \[ \].
    const source = element.textContent.trim();
    katex.render(source.slice(2, -2), element, {
      displayMode: source.startsWith("\\["),
      throwOnError: true,
    });
  }
});
