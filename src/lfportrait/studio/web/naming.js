// A dialog that asks for a name.

import { ask, h } from "./dom.js";
import { t } from "./i18n.js";

/** Ask for a name; "" if it was left. */
export async function nameOf(title, value, word) {
  const input = h("input", {
    type: "text",
    value,
    required: true,
    maxlength: 80,
    autofocus: true,
    autocomplete: "off",
  });
  const answer = await ask(title, h("label.field", {}, h("span", { text: t("name") }), input), [
    ["", t("cancel")],
    ["yes", word, "main"],
  ]);
  return answer ? input.value.trim() : "";
}
