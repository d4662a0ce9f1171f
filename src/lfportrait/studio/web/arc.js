// Where the photos were taken from, seen from above: a dot a photo, the gaps between them.

import { h } from "./dom.js";
import { t } from "./i18n.js";

const MIDDLE = [200, 62],
  FAR = 150;

/** Place on the arc of an angle in degrees: 0 is before the face (below), positive to the right. */
function at(yaw, far = FAR) {
  const angle = (yaw * Math.PI) / 180;
  return [MIDDLE[0] + far * Math.sin(angle), MIDDLE[1] + far * Math.cos(angle)];
}

const text = (place) => place.map((value) => value.toFixed(1)).join(" ");

function sector(from, to, inner, outer) {
  const wide = Math.abs(to - from) > 180 ? 1 : 0;
  return (
    `M${text(at(from, outer))}A${outer} ${outer} 0 ${wide} 0 ${text(at(to, outer))}` +
    `L${text(at(to, inner))}A${inner} ${inner} 0 ${wide} 1 ${text(at(from, inner))}Z`
  );
}

/**
 * The drawing.
 * @param {object} arc Of the server: gaps, yaws, placed.
 * @param {object[]} photos
 * @param {function} onpick Called with a photo's id when its dot is pressed.
 */
export function drawArc({ gaps = [], yaws = [], placed = false }, photos, onpick) {
  const seen = photos.filter(
    (photo) =>
      !photo.left_out &&
      (photo.placed?.yaw ?? photo.yaw) !== null &&
      (photo.placed?.yaw ?? photo.yaw) !== undefined,
  );
  const frames = seen.length ? [] : yaws; // of a video
  const n = seen.length || frames.length;
  const words = n ? t("arc.words", { n, gaps: gaps.length }) : t("arc.none");
  return h(
    "figure.arc",
    h(
      "svg:svg",
      { viewBox: "0 0 400 248", role: "img", "aria-label": words },
      h("svg:path.ring", { d: `M${text(at(-90))}A${FAR} ${FAR} 0 0 0 ${text(at(90))}` }),
      gaps.map(([from, to]) =>
        h(
          "svg:g",
          h("svg:path.gap", { d: sector(from, to, FAR - 22, FAR + 14) }),
          h("svg:text.degrees", {
            x: at((from + to) / 2, FAR - 40)[0],
            y: at((from + to) / 2, FAR - 40)[1],
            text: `${Math.round(to - from)}°`,
          }),
        ),
      ),
      // The head from above, its nose down to the front.
      h("svg:ellipse.head", { cx: MIDDLE[0], cy: MIDDLE[1] - 6, rx: 27, ry: 34 }),
      h("svg:path.nose", { d: `M${MIDDLE[0] - 6} ${MIDDLE[1] + 26}q6 15 12 0` }),
      h("svg:text.side.end", { x: MIDDLE[0] - 36, y: MIDDLE[1] + 2, text: t("arc.left") }),
      h("svg:text.side", { x: MIDDLE[0] + 36, y: MIDDLE[1] + 2, text: t("arc.right") }),
      h("svg:text.side.middle", { x: 200, y: 242, text: t("arc.front") }),
      frames.map((yaw) => {
        const [x, y] = at(yaw);
        return h("svg:circle.shot.green.frame", { cx: x.toFixed(1), cy: y.toFixed(1), r: 3 });
      }),
      seen.map((photo) => {
        const yaw = photo.placed?.yaw ?? photo.yaw,
          pitch = photo.placed?.pitch ?? photo.pitch ?? 0;
        const [x, y] = at(yaw, FAR - Math.max(-30, Math.min(30, pitch)) * 0.5);
        return h(
          "svg:circle.shot",
          { cx: x.toFixed(1), cy: y.toFixed(1), r: 4.5, class: photo.grade, onclick: () => onpick(photo.id) },
          h("svg:title", `${photo.name}: ${yaw.toFixed(0)}°`),
        );
      }),
    ),
    h("figcaption.small.soft", t(placed ? "arc.placed" : "arc.guessed")),
  );
}
