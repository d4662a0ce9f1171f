// How the head stands in a panel: the command line's parameters, and the depth that the panel has.

import { button, check, fill, h, segments, slider } from "./dom.js";
import { said, t } from "./i18n.js";

export const PLACE = {
  size: 0.8,
  shift_x: 0,
  shift_y: -0.04,
  focus: 0,
  depth_scale: 1,
  turn: 0,
  compose: true,
  ground: "painted",
  ground_depth: 0.45,
  blend: "nearest",
};
const SLIDERS = [
  ["size", 0.3, 1.6, 0.01],
  ["focus", -1, 1, 0.01],
  ["depth_scale", 0.2, 1.5, 0.01],
  ["shift_y", -0.6, 0.6, 0.01],
  ["turn", -40, 40, 1],
  ["ground_depth", 0, 1.5, 0.01],
];

/** The placement without what is as `make` has it. */
export function changesOf(place) {
  return Object.fromEntries(Object.entries(place).filter(([name, value]) => value !== PLACE[name]));
}

/** Controls of a placement, which they change; `onchange` follows each change, `onreset` a new one. */
export function placementPanel(place, onchange, onreset) {
  const put = (name, value) => {
    place[name] = value;
    onchange();
  };
  const sliders = SLIDERS.map(([name, min, max, step]) =>
    slider(name, {
      min,
      max,
      step,
      value: place[name],
      digits: step < 1 ? 2 : 0,
      note: t(`place.${name}`),
      oninput: (value) => put(name, value),
    }),
  );
  const choice = (name, values) =>
    h(
      "div.field",
      h("span", h("code", name)),
      segments(
        name,
        values.map((value) => [value, t(`${name}.${value}`)]),
        place[name],
        (value) => put(name, value),
      ),
    );
  return h(
    "section.stack",
    { "aria-label": t("place.title") },
    h("div.row.between", h("h2", t("place.title")), button(t("place.reset"), onreset, { kind: "quiet" })),
    check(
      { id: "compose", checked: place.compose, onchange: (yes) => put("compose", yes) },
      h("span", h("code", "compose"), " ", h("span.soft.small", t("place.compose"))),
    ),
    sliders,
    choice("ground", ["painted", "black", "white"]),
    choice("blend", ["nearest", "continuous", "filtered"]),
  );
}

/** A bar of depth: what is sharp, and where the head lies in it. */
export function drawBudget(box, { lines, sharp, head }) {
  const least = Math.min(sharp[0], head[0], 0) - 0.1,
    most = Math.max(sharp[1], head[1], 0) + 0.1;
  const x = (value) => (400 * (value - least)) / (most - least);
  const words = {
    back: head[0].toFixed(2),
    front: head[1].toFixed(2),
    from: sharp[0].toFixed(2),
    to: sharp[1].toFixed(2),
  };
  fill(
    box,
    h(
      "figure.budget",
      h(
        "svg:svg",
        { viewBox: "0 0 400 64", role: "img", "aria-label": t("budget.alt", words) },
        h("svg:rect.sharp", { x: x(sharp[0]), y: 10, width: x(sharp[1]) - x(sharp[0]), height: 34, rx: 4 }),
        h("svg:rect.head", { x: x(head[0]), y: 19, width: x(head[1]) - x(head[0]), height: 16, rx: 8 }),
        h("svg:path.plane", { d: `M${x(0)} 4V50` }),
        h("svg:text.middle", { x: x(0), y: 62, text: t("budget.plane") }),
        h("svg:text", { x: 0, y: 62, text: t("budget.back") }),
        h("svg:text.end", { x: 400, y: 62, text: t("budget.front") }),
      ),
    ),
    h(
      "ul.small.soft",
      lines.map((text) => h("li", said(text))),
    ),
  );
}
