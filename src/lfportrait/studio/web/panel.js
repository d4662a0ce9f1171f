// The window on the second screen: a coded picture pixel for pixel, as the studio's page bids.

import { speak, t } from "./i18n.js";

const line = new BroadcastChannel("lfportrait-panel");
const note = document.getElementById("note"),
  panel = document.getElementById("panel");
let wanted = null;

/** Width and height of the window in pixels of the screen. */
const pixels = () => [innerWidth, innerHeight].map((n) => Math.round(n * devicePixelRatio));

function check() {
  const image = panel.querySelector("img");
  if (!image?.naturalWidth) return;
  // A pixel of the picture for each of the screen, whatever the desktop enlarges by.
  image.style.width = `${image.naturalWidth / devicePixelRatio}px`;
  image.style.height = `${image.naturalHeight / devicePixelRatio}px`;
  const [wide, high] = pixels(),
    fits = wide === image.naturalWidth && high === image.naturalHeight;
  note.textContent = fits
    ? ""
    : t(document.fullscreenElement ? "panel.size" : "panel.full", {
        panel: `${image.naturalWidth} x ${image.naturalHeight}`,
        window: `${wide} x ${high}`,
      });
  line.postMessage({ shown: wanted, fits, window: [wide, high] });
}

async function show(path) {
  wanted = path;
  const image = new Image();
  image.alt = "";
  image.src = path;
  await image.decode().catch(() => {});
  if (path !== wanted) return;
  panel.replaceChildren(image);
  check();
}

line.onmessage = ({ data }) => {
  if (data.show) show(data.show);
  if (data.close) close();
};
addEventListener("resize", check);
document.addEventListener("fullscreenchange", check);
panel.addEventListener("click", () => document.documentElement.requestFullscreen().catch(() => {}));
addEventListener("keydown", (event) => {
  if (event.key === "f" || event.key === "Enter")
    document.documentElement.requestFullscreen().catch(() => {});
  else if (event.key === "Escape" && !document.fullscreenElement) close();
});
addEventListener("pagehide", () => line.postMessage({ gone: true }));
await speak();
panel.focus();
line.postMessage({ ready: true });
