// Dialogs whose answers may be refused, and one that asks for a name.

import { ask, h, icon } from "./dom.js";
import { t } from "./i18n.js";

/**
 * Ask for something and act on it, until that is done or left: what is refused is asked for again.
 * @param {function} question Asks and gives the answer, "" where it was left; its argument says why
 *   the answer before was refused, "" at first.
 * @param {function} act Takes the answer.
 * @param {string[]} codes Of the refusals that another answer may help against.
 * @returns what `act` gives; undefined where it was left.
 */
export async function answered(question, act, codes) {
  for (let wrong = ""; ; ) {
    const answer = await question(wrong);
    if (!answer) return undefined;
    try {
      return await act(answer);
    } catch (error) {
      if (!codes.includes(error.code)) throw error;
      wrong = error.message;
    }
  }
}

/** Ask for a name and do something with it (`answered`). */
export async function named(title, value, word, act) {
  let name = value;
  const question = async (wrong) => {
    name = await nameOf(title, name, word, wrong);
    return name;
  };
  return await answered(question, act, ["bad_name", "exists"]);
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
      wrong && h("p.note.bad", { role: "alert" }, icon("bad"), wrong),
      h("label.field", h("span", t("name")), input),
    ),
    [["yes", word, "main"]],
  );
  return answer ? input.value.trim() : "";
}
