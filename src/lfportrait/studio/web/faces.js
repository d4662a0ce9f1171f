// Which of a painting's faces is meant: their boxes on the picture, each a button.

import { bitmap, get, post } from "./api.js";
import { ask, h } from "./dom.js";
import { t } from "./i18n.js";
import { say } from "./shell.js";

/** Ask, and write the choice. @returns {Promise<boolean>} Whether it was changed. */
export async function chooseFace(sitter, style) {
  const query = `?project=${sitter.id}`;
  const { faces, width, height, chosen } = await get(`/api/styles/${style.id}/faces${query}`);
  const image = await bitmap(style.full);
  const canvas = h("canvas", { width, height, "aria-hidden": "true" });
  canvas.getContext("2d").drawImage(image, 0, 0, width, height);
  let picked = chosen;
  const boxes = faces.map(({ number, box: [x, y, wide, high] }) => {
    const one = h(
      "button.face-box",
      {
        "aria-pressed": String(number === chosen),
        "aria-label": t("face.one", { n: number }),
        onclick: () => {
          picked = number;
          for (const each of boxes) each.setAttribute("aria-pressed", String(each === one));
        },
      },
      h("span", number),
    );
    one.style.left = `${(100 * x) / width}%`;
    one.style.top = `${(100 * y) / height}%`;
    one.style.width = `${(100 * wide) / width}%`;
    one.style.height = `${(100 * high) / height}%`;
    return one;
  });
  const answer = await ask(
    t("face.title"),
    h("div.stack", h("p.soft", t("face.text")), h("div.face-choice", canvas, boxes)),
    [["yes", t("face.take"), "main"]],
  );
  if (!answer || picked === chosen) return false;
  await post(`/api/styles/${style.id}/face${query}`, { face: picked });
  say(t("face.taken", { n: picked }));
  return true;
}
