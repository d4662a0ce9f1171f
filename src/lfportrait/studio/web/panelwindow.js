// The page's side of the window on the panel: open it there, tell it what to show, hear whether it fits.

import { fail, say } from "./shell.js";
import { t } from "./i18n.js";

const line = new BroadcastChannel("lfportrait-panel");
const watchers = new Set();
let open = false,
  wanted = null;

line.onmessage = ({ data }) => {
  if (data.ready) {
    open = true;
    if (wanted) line.postMessage({ show: wanted });
  }
  if (data.gone) open = false;
  for (const act of watchers) act(data);
};

/** Call `act` with what the window says: {shown, fits, window}, {gone}. Returns what ends it. */
export function watchPanel(act) {
  watchers.add(act);
  return () => watchers.delete(act);
}

/** Where the second screen lies, if the browser may say it. */
async function place(width, height) {
  if (!("getScreenDetails" in window) || !screen.isExtended) return "";
  const details = await window.getScreenDetails().catch(() => null);
  const other =
    details?.screens.find(
      (each) =>
        each.width * each.devicePixelRatio === width && each.height * each.devicePixelRatio === height,
    ) ?? details?.screens.find((each) => each !== details.currentScreen);
  return other
    ? `left=${other.availLeft},top=${other.availTop},width=${other.availWidth},height=${other.availHeight}`
    : "";
}

/** Show a picture in the panel's window; it is opened where it is not. */
export async function showOnPanel(path, { width, height }) {
  wanted = path;
  if (open) return line.postMessage({ show: path });
  const where = await place(width, height).catch(fail);
  const made = window.open("/static/panel.html", "lfportrait-panel", where || "width=960,height=540");
  if (!made) say(t("panel.blocked"), { wrong: true });
}

export function closePanel() {
  wanted = null;
  line.postMessage({ close: true });
}
