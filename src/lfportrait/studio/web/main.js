// The page's beginning, and which screen is seen: the address names screen, sitter and what is open.

import { leaveScreen } from "./api.js";
import { button, fill, h, keepPresses, later } from "./dom.js";
import { speak, t } from "./i18n.js";
import { sweep } from "./lane.js";
import { drawShell, fail, forget, markSteps, SCREENS, watchServer } from "./shell.js";
import { enter, listen, on, project, refresh } from "./state.js";
import { showMaking } from "./screens/making.js";
import { showPhotos } from "./screens/photos.js";
import { showPortrait } from "./screens/portrait.js";
import { showShow } from "./screens/show.js";
import { showSitters } from "./screens/sitters.js";
import { showStyle } from "./screens/style.js";

const SHOW = {
  sitters: showSitters,
  photos: showPhotos,
  making: showMaking,
  style: showStyle,
  portrait: showPortrait,
  show: showShow,
};
let leave = null,
  left = null,
  shown = "",
  number = 0;

/** A part of the address as it was meant; what can't be is no address of ours. */
function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** Screen, sitter and the rest of the address. */
function address() {
  const [screen, id = "", ...rest] = location.hash.slice(1).split("/").map(decoded);
  return SCREENS.includes(screen) && (screen === "sitters" || project(id))
    ? [screen, id, rest]
    : ["sitters", "", []];
}

async function route(again = false) {
  const [screen, id, rest] = address();
  const wanted = [screen, id, ...rest].join("/");
  if (wanted === shown && again !== true) return;
  const mine = ++number;
  shown = wanted;
  if (leave) {
    left = leave();
    leave = null;
  }
  // What a screen has to keep is kept before the next one reads it.
  await left;
  if (mine !== number) return;
  leaveScreen();
  forget();
  const main = document.getElementById("main");
  drawShell(screen, id, () => route(true));
  document.title = [project(id)?.name, t(`step.${screen}`), "lfportrait studio"].filter(Boolean).join(" · ");
  const root = h("div.screen", { "data-screen": screen });
  // Pictures that are still on their way would hold up what the next screen asks for.
  for (const image of main.querySelectorAll("img")) image.removeAttribute("src");
  fill(main, root);
  sweep();
  scrollTo(0, 0);
  try {
    const ends = await SHOW[screen](root, project(id), rest);
    // Somebody went on while it was drawn.
    if (mine !== number) ends?.();
    else leave = ends;
  } catch (error) {
    fail(error);
    if (mine === number) unseen(root, screen, error);
  }
  if (mine !== number) return;
  root.dataset.ready = "";
  const title = root.querySelector("h1");
  title?.setAttribute("tabindex", "-1");
  // Not on the first picture: then the page itself has the focus.
  if (route.before && !root.contains(document.activeElement)) title?.focus({ preventScroll: true });
  route.before = true;
}

/** A screen that can't be shown says so, and can be tried again. */
function unseen(root, screen, error) {
  fill(
    root,
    h(
      "div.empty",
      h("h1", t(`step.${screen}`)),
      h("p", error.code === undefined ? t("error.page") : error.message),
      button(t("again"), () => route(true), { drawing: "reset" }),
    ),
  );
}

async function begin() {
  // The address of a studio that was started again, opened in the page of the one before, or where
  // the page was not let in.
  addEventListener("hashchange", () => {
    if (location.hash.startsWith("#token=")) location.reload();
  });
  try {
    await speak();
    await enter();
    await refresh();
  } catch (error) {
    fail(error);
    const text = error.code === "no_session" ? t("error.no_session") : error.message;
    return fill(document.getElementById("main"), h("div.empty", h("h1", "lfportrait studio"), h("p", text)));
  }
  watchServer();
  listen();
  keepPresses();
  document.getElementById("skip").addEventListener("click", (event) => {
    event.preventDefault();
    document.getElementById("main").focus();
  });
  addEventListener("hashchange", () => location.hash.startsWith("#token=") || route());
  // A file that misses a drop zone must not replace the page.
  for (const name of ["dragover", "drop"]) addEventListener(name, (event) => event.preventDefault());
  const shell = () => {
    const [screen, id] = address();
    drawShell(screen, id, () => route(true));
  };
  const soon = later(shell, 300);
  for (const kind of ["project", "job", "state"]) on(kind, soon);
  on("progress", () => markSteps(address()[1]));
  on("project-removed", () => route(true));
  await route();
}

begin();
