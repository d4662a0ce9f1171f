// The page's beginning, and what it does when something is missing.

const HEADER = JSON.parse(document.getElementById("portrait").textContent);

/** The poster instead of the live picture, with a sentence that says why. */
function stand(error, viewer) {
  if (viewer) viewer.stopped = true;
  document.body.classList.remove("live");
  document.body.classList.add("standing");
  tell(error instanceof UserError ? error.message
    : "The moving portrait can't be shown: its data are damaged, or this browser is too old. Get the file once more, or try another browser.", true);
}

/** All that the graphics held is made again from the page's data. */
async function revive(renderer, mix, viewer) {
  try {
    renderer.forget();
    await renderer.load();
    await mix.apply();
    viewer.stopped = false;
    document.body.classList.remove("standing");
    document.body.classList.add("live");
    tell("");
    viewer.change();
  } catch (error) {
    stand(error, viewer);
  }
}

async function begin() {
  const canvas = document.getElementById("canvas"), stage = document.getElementById("stage");
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let viewer = null;
  try {
    if (!document.querySelector("script[data-end]")) {
      throw new UserError("This file is incomplete: it was cut off on its way. Get it once more. This is a still picture of the portrait.");
    }
    if (typeof DecompressionStream === "undefined") {
      throw new UserError("This browser is too old for the moving portrait. This is a still picture of it.");
    }
    const renderer = new Renderer(canvas, HEADER);
    const orbit = new Orbit(HEADER.start);
    viewer = new Viewer(renderer, orbit, calm.matches);
    calm.addEventListener("change", () => {
      viewer.calm = calm.matches;
      viewer.change(false);
    });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      stand(new UserError("The graphics driver took the picture away; this is a still one. It comes back by itself if the driver allows."), viewer);
    });
    await renderer.load();
    const mix = new Mix(renderer, viewer);
    await mix.apply();
    canvas.addEventListener("webglcontextrestored", () => revive(renderer, mix, viewer));
    viewer.resize();
    viewer.touched = -REST; // the head moves from the beginning
    viewer.frame(performance.now());
    document.body.classList.add("live");
    new Input(canvas, viewer);
    tools(viewer, stage);
    const panels = new PanelMode(viewer, stage);
    new ResizeObserver(() => viewer.resize()).observe(canvas);
    document.addEventListener("visibilitychange", () => viewer.wake());
    // For pages that embed this one, and for tests.
    window.lfportrait = { renderer, viewer, orbit, mix, panels, Panel, readDisplay, makeDisplay };
    document.documentElement.dataset.ready = String(Math.round(performance.now()));
    // The slider's other end, before somebody asks for it.
    if (HEADER.sets.length > 1) {
      setTimeout(() => {
        renderer.program("mixed");
        mix.apply(true).catch((error) => stand(error, viewer));
      }, 600);
    }
  } catch (error) {
    if (!(error instanceof UserError)) console.warn(error);
    stand(error, viewer);
  }
}

if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", begin);
else begin();
