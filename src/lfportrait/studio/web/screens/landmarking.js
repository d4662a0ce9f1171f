// The landmark editor's screen: the painting at the left, this sitter beside it.

import { bitmap, get, post, send } from "../api.js";
import { fill, h, heading, icon, later } from "../dom.js";
import { growingPicture, quickPicture } from "../lane.js";
import { LandmarkEditor } from "../editor.js";
import { t } from "../i18n.js";
import { Landmarks } from "../landmarks.js";
import { Preview } from "../preview.js";
import { doing, fail } from "../shell.js";
import { Viewport } from "../viewport.js";

/** Title, way back and what is saved, above an editor. */
export function editorHead(sitter, style, title, saved) {
  return heading(
    t(title, { name: style.name }),
    saved,
    h("a.button.main", { href: `#style/${sitter.id}/${style.id}` }, icon("left"), t("editor.done")),
  );
}

/** A style of the gallery by its id, null where there is none. */
export async function styleOf(sitter, id) {
  const { styles } = await get(`/api/styles?project=${sitter.id}`);
  return styles.find((each) => each.id === id) ?? null;
}

/** The painting, until its editor is there. */
export function whileRead(root, head, style) {
  const painting = h("img", { alt: t("style.alt", { name: style.name }) });
  fill(
    root,
    head,
    h(
      "figure.reading",
      growingPicture(painting, style.picture, style.full, quickPicture),
      h("figcaption.soft", { role: "status", text: t("editor.reading") }),
    ),
  );
}

/** What was removed, perhaps in another window, has no editor. */
export function toGallery(sitter) {
  location.hash = `#style/${sitter.id}`;
}

export async function showLandmarks(root, sitter, id) {
  root.classList.add("full");
  const style = await styleOf(sitter, id);
  if (!style) return toGallery(sitter);
  const query = `?project=${sitter.id}`,
    path = `/api/styles/${id}/landmarks${query}`;
  const saved = h("p.soft", { role: "status" });
  const head = editorHead(sitter, style, "editor.title", saved);
  whileRead(root, head, style);
  const image = await bitmap(style.full);
  let held = await get(path).catch((error) =>
    error.code === "not_found" || error.code === "user_error" ? null : Promise.reject(error),
  );
  if (!held?.points) {
    held = await placed(root, head, style, image, query);
    if (!held) return () => {};
  }
  const landmarks = new Landmarks(held.points, [held.width, held.height]);
  const preview = new Preview(sitter, () => ({
    style: id,
    landmarks: landmarks.points,
    draft: true,
    slot: "editor",
    size: 480,
  }));
  const write = async () => {
    saved.textContent = t("editor.saving");
    await send("PUT", path, { points: landmarks.points });
    saved.textContent = t("editor.saved");
  };
  let open = false;
  const save = later(() => {
    open = false;
    write().catch(fail);
  }, 500);
  const editor = new LandmarkEditor(image, landmarks, {
    onreset: doing(async () => {
      save.stop();
      const { points } = await send("DELETE", path);
      // Where none was found there is nothing to go back to but its place.
      if (!points) return location.reload();
      landmarks.put(points);
    }),
  });
  landmarks.watch(() => {
    open = true;
    saved.textContent = t("editor.open");
    save();
    preview.ask();
  });
  fill(root, head, h("div.editing", editor.element, preview.element));
  saved.textContent = t(held.edited ? "editor.edited" : "editor.found");
  preview.draw();
  return async () => {
    save.stop();
    preview.close();
    editor.close();
    if (open) await write().catch(fail);
  };
}

/** Where no face was found: a press on the middle of the face, by hand or with the arrow keys. */
function placed(root, head, style, image, query) {
  return new Promise((done) => {
    const view = new Viewport(image, [style.width, style.height]);
    let at = [style.width / 2, style.height / 2];
    const target = h(
      "svg:g.mark.target",
      { tabindex: 0, role: "button", "aria-label": t("place.target") },
      h("svg:circle.halo", { r: 16 }),
      h("svg:circle.dot", { r: 3 }),
    );
    const draw = () => target.setAttribute("transform", `translate(${view.outside(at).join(" ")})`);
    const take = doing(async () => done(await post(`/api/styles/${style.id}/face${query}`, { at })));
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    target.addEventListener("keydown", (event) => {
      if (event.key === "Enter") return take(event);
      if (!steps[event.key]) return;
      event.preventDefault();
      at = at.map((value, k) => value + steps[event.key][k] * (event.shiftKey ? 10 : 1));
      draw();
    });
    view.taken = (event) => event.button === 0 && !event.target.closest("button");
    view.element.addEventListener("pointerdown", (event) => {
      if (view.held || event.target.closest("button")) return;
      at = view.inside(event);
      draw();
    });
    view.watch(draw);
    view.element.append(h("svg:svg.points", target), view.buttons());
    fill(
      root,
      head,
      h("p.note.fair", icon("fair"), t("place.text")),
      h(
        "div.editing",
        h(
          "div.editor",
          view.element,
          h("div.row", h("button.button.main", { onclick: take, text: t("place.take") })),
        ),
      ),
    );
  });
}
