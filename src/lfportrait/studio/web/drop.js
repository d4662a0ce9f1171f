// Files that are chosen, dropped anywhere on a screen, or pasted.

import { button, h } from "./dom.js";
import { droppedFiles } from "./uploads.js";

const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");

/** A button by which files are chosen, and the input behind it; `take` is called with the files. */
export function chooser(text, looks, attributes, take) {
  const input = h("input", {
    type: "file",
    hidden: true,
    ...attributes,
    onchange: () => {
      take([...input.files]);
      input.value = "";
    },
  });
  return [button(text, () => input.click(), looks), input];
}

/**
 * Take files that are dropped on the screen or pasted, until the function that comes back is called.
 * @param {string} words What is shown while files are held over the screen.
 * @param {function} take Called with the files, and whether they were pasted.
 */
export function takeFiles(words, take) {
  const main = document.getElementById("main");
  let depth = 0;
  const over = (yes) => {
    main.classList.toggle("over", yes);
    if (yes) main.dataset.drop = words;
    else depth = 0;
  };
  const listeners = {
    dragenter: (event) => {
      if (!hasFiles(event)) return;
      depth++;
      over(true);
    },
    // Parts of the screen are entered before others are left.
    dragleave: (event) => hasFiles(event) && --depth <= 0 && over(false),
    dragover: (event) => event.preventDefault(),
    drop: async (event) => {
      event.preventDefault();
      over(false);
      if (hasFiles(event)) take(await droppedFiles(event.dataTransfer).catch(() => []), false);
    },
  };
  const pasted = (event) => {
    const files = [...(event.clipboardData?.files ?? [])];
    if (!files.length || document.querySelector("dialog[open]")) return;
    event.preventDefault();
    take(files, true);
  };
  for (const [name, act] of Object.entries(listeners)) main.addEventListener(name, act);
  document.addEventListener("paste", pasted);
  return () => {
    over(false);
    for (const [name, act] of Object.entries(listeners)) main.removeEventListener(name, act);
    document.removeEventListener("paste", pasted);
  };
}
