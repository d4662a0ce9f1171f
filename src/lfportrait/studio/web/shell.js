// The frame about the screens: steps, sitter, theme, language, messages.

import { watchLine } from "./api.js";
import { button, fill, h, icon, segments, sign } from "./dom.js";
import { LANGUAGES, language, speak, t } from "./i18n.js";
import { isLive, jobsOf, on, project } from "./state.js";
import { shareOf } from "./times.js";

export const SCREENS = ["sitters", "photos", "making", "style", "portrait", "show"];
const READ = 6000; // milliseconds that a message can be read at least
const find = (id) => document.getElementById(id);

/**
 * A message that goes by itself, or stays where something is wrong.
 * @param {string} text
 * @param {object} how `wrong`; `back`: what takes back what was done, by a button of the message.
 */
export function say(text, { wrong = false, back = null } = {}) {
  const box = find(wrong ? "alerts" : "toasts");
  if ([...box.children].some((each) => each.textContent === text)) return;
  const toast = h(
    "div.toast",
    h("p", text),
    back &&
      action(t("undo"), { kind: "quiet" }, async () => {
        await back();
        toast.remove();
      }),
    tool("close", t("close"), () => toast.remove()),
  );
  toast.dataset.at = String(performance.now());
  box.append(toast);
  while (box.children.length > 3) box.firstChild.remove();
  if (!wrong) setTimeout(() => toast.remove(), back ? 4 * READ : READ);
}

/** On another screen, what went wrong on the one before is not said any longer than it takes to read it. */
export function forget() {
  for (const toast of find("alerts").querySelectorAll("[data-at]"))
    if (performance.now() - Number(toast.dataset.at) > READ) toast.remove();
}

/** Say what went wrong; what was stopped on purpose is nothing. */
export function fail(error) {
  if (error?.name === "AbortError") return;
  if (error?.code === undefined) console.error(error);
  say(error?.code === undefined ? t("error.page") : error.message, { wrong: true });
}

/** For those who hear the page: how far something is. */
export function murmur(text) {
  find("progress").textContent = text;
}

/** Do something that takes a while by a button, once at a time, and say what went wrong. */
export function doing(act) {
  return async (event) => {
    const pressed = event?.currentTarget;
    pressed?.setAttribute("aria-disabled", "true");
    if (pressed?.dataset.busy) return;
    if (pressed) pressed.dataset.busy = "1";
    try {
      await act(event);
    } catch (error) {
      fail(error);
    } finally {
      if (pressed) delete pressed.dataset.busy;
      pressed?.removeAttribute("aria-disabled");
    }
  };
}

/** A button for something that takes a while (`doing`); it looks as `button` says. */
export function action(text, looks, act) {
  return button(text, doing(act), looks);
}

/** The same with a drawing alone. */
export function tool(drawing, name, act) {
  return sign(drawing, name, doing(act), "quiet tool");
}

/** Theme and language. */
export function preferences(again) {
  const theme = segments(
    t("theme"),
    [
      ["auto", t("theme.auto")],
      ["light", t("theme.light")],
      ["dark", t("theme.dark")],
    ],
    document.documentElement.dataset.theme,
    (value) => {
      document.documentElement.dataset.theme = value;
      keep("lfportrait.theme", value);
      for (const each of document.querySelectorAll(".preferences .segments")) each.show(value);
    },
  );
  const choice = h(
    "select",
    {
      "aria-label": t("language"),
      onchange: async () => {
        await speak(choice.value);
        again();
      },
    },
    Object.entries(LANGUAGES).map(([value, text]) =>
      h("option", { value, text, selected: value === language }),
    ),
  );
  return h("div.preferences", theme, choice);
}

function keep(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // No storage in this window: it holds until the reload.
  }
}

/** What stands beside a step's name: how much there is, or how far it is. */
function mark(screen, sitter) {
  if (!sitter) return ["", ""];
  if (screen === "photos" && sitter.photos) return [String(sitter.photos), ""];
  if (screen === "making") {
    const job = jobsOf(sitter.id).find((each) => isLive(each) && ["head", "fine"].includes(each.kind));
    const share = job?.state === "running" ? shareOf(job) : null;
    if (job) return [share === null ? t(`job.${job.state}`) : `${Math.round(100 * share)} %`, ""];
    if (sitter.has.field) return ["✓", "good"];
  }
  if (screen === "style" && sitter.has.styled) return ["✓", "good"];
  return ["", ""];
}

/** How far the steps are: numbers alone, while something runs. */
export function markSteps(id) {
  for (const each of find("steps").querySelectorAll("a[data-step]")) {
    const [text, kind] = mark(each.dataset.step, project(id));
    const state = each.querySelector(".state");
    state.textContent = text;
    state.className = `state ${kind}`;
  }
}

/** Draw the frame for a screen. */
export function drawShell(screen, id, again) {
  const sitter = project(id);
  fill(find("skip"), t("skip"));
  fill(
    find("top"),
    h("a.brand", { href: "#sitters" }, "lfportrait ", h("span", "studio")),
    sitter &&
      h(
        "a.who",
        { href: `#${screen === "sitters" ? "portrait" : screen}/${id}` },
        sitter.thumbnail
          ? h("img.face", { src: sitter.thumbnail, alt: "", width: 45, height: 45 })
          : h("span.face"),
        h(
          "span",
          h("span.small.soft", t("sitter")),
          h("strong.some", { text: sitter.name, title: sitter.name }),
        ),
      ),
  );
  const steps = find("steps");
  const focused = [...steps.querySelectorAll("a, button, select")].indexOf(document.activeElement);
  steps.setAttribute("aria-label", t("steps"));
  fill(
    steps,
    h(
      "ol",
      SCREENS.map((name) => {
        const open = name === "sitters" || sitter;
        return h(
          "li",
          h(
            "a",
            {
              href: open ? `#${name}${name === "sitters" ? "" : `/${id}`}` : null,
              role: open ? null : "link",
              "aria-current": name === screen ? "page" : null,
              "aria-disabled": open ? null : "true",
              "data-step": name,
            },
            icon(name),
            h("span", t(`step.${name}`)),
            h("span.state"),
          ),
        );
      }),
    ),
    preferences(again),
  );
  markSteps(id);
  if (focused >= 0) steps.querySelectorAll("a, button, select")[focused]?.focus();
}

/** Follow the line to the server. */
export function watchServer() {
  let gone = null;
  watchLine((yes) => {
    gone?.remove();
    gone = null;
    if (yes) return say(t("line.back"));
    gone = h("div.toast", h("p", t("line.gone")));
    find("alerts").append(gone);
  });
  on("disk", ({ free_bytes: free }) => say(t("disk.low", { n: (free / 1e9).toFixed(1) }), { wrong: true }));
  on("notice", ({ code, message }) =>
    say(t(`error.${code}`) === `error.${code}` ? message : t(`error.${code}`), { wrong: true }),
  );
}
