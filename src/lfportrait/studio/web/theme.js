// Light or dark before the first picture, so that nothing flashes. A plain script: modules wait.
(() => {
  let kept = "auto";
  try {
    kept = localStorage.getItem("lfportrait.theme") ?? "auto";
  } catch {
    // No storage in this window: the system's choice.
  }
  document.documentElement.dataset.theme = ["light", "dark"].includes(kept) ? kept : "auto";
})();
