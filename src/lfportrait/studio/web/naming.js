// A dialog that asks for a name.

import { ask, h, icon } from "./dom.js";
import { t } from "./i18n.js";

/**
 * Ask for a name and do something with it, until it is done or left: a name that is refused is asked
 * for again, with why.
 */
export async function named(title, value, word, act) {
  let [name, wrong] = [value, ""];
  for (;;) {
    name = await nameOf(title, name, word, wrong);
    if (!name) return;
    try {
      return await act(name);
    } catch (error) {
      if (!["bad_name", "exists"].includes(error.code)) throw error;
      wrong = error.message;
    }
  }
}

/** Ask for a name; "" if it was left. `wrong` says what is the matter with the proposed one. */
export async function nameOf(title, value, word, wrong = "") {
  const input = h("input", {
    type: "text",
    value,
    required: true,
    pattern: ".*\\S.*",
    maxlength: 80,
    autofocus: true,
    autocomplete: "off",
  });
  const answer = await ask(
    title,
    h(
      "div.stack",
      {},
      wrong && h("p.note.bad", { role: "alert" }, icon("bad"), wrong),
      h("label.field", {}, h("span", { text: t("name") }), input),
    ),
    [
      ["", t("cancel")],
      ["yes", word, "main"],
    ],
  );
  return answer ? input.value.trim() : "";
}
