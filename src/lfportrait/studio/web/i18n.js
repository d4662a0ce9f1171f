// The page's words. Numbers and names of parameters are the same in all languages.

export const LANGUAGES = { en: "English", de: "Deutsch" };

let words = {},
  spare = {},
  sentences = [];
export let language = "en";

async function read(name) {
  const answer = await fetch(`/static/strings.${name}.json`);
  if (!answer.ok) throw new Error(`strings.${name}.json: ${answer.status}`);
  return answer.json();
}

/** Read the strings of a language, or of the one that was chosen last, or the browser's. */
export async function speak(wanted = null) {
  let kept = null;
  try {
    kept = localStorage.getItem("lfportrait.language");
    if (wanted) localStorage.setItem("lfportrait.language", wanted);
  } catch {
    // No storage in this window: the browser's language each time.
  }
  const first = wanted ?? kept ?? navigator.language.slice(0, 2);
  language = first in LANGUAGES ? first : "en";
  spare = await read("en");
  words = language === "en" ? spare : await read(language);
  sentences = language === "en" ? [] : patterns(await read(`server.${language}`));
  document.documentElement.lang = language;
}

/**
 * A text in the chosen language.
 * @param {string} key Of strings.*.json.
 * @param {object} values For the places {name} in it. `{n|one|many}` chooses by the number n.
 */
export function t(key, values = {}) {
  const text = words[key] ?? spare[key] ?? key;
  return text.replace(/\{(\w+)(?:\|([^|}]*)\|([^}]*))?\}/g, (_, name, one, many) => {
    const value = values[name] ?? "";
    return one === undefined ? String(value) : Number(value) === 1 ? one : many;
  });
}

/** What the server's English sentences look like, those that say the most first. */
function patterns(table) {
  const own = (text) => text.replaceAll("{}", "").length;
  return Object.entries(table)
    .sort(([one], [other]) => own(other) - own(one))
    .map(([english, other]) => {
      const parts = english.split("{}").map((part) => part.replace(/[.*+?^${}()|[\]\\/]/g, "\\$&"));
      return [new RegExp(`^${parts.join("([^]*?)")}$`), other];
    });
}

/** A sentence of the server's, which is English, in the chosen language; what nobody knows stays as it is. */
export function said(text) {
  if (typeof text !== "string") return text;
  for (const [pattern, other] of sentences) {
    const values = pattern.exec(text)?.slice(1);
    if (values) return other.replaceAll("{}", () => part(values.shift()));
  }
  return text;
}

/** What stands in a sentence's place: a name, a number, or words that are known, too. */
function part(value) {
  const one = value.split(", ");
  const other = one.map(said);
  // A list of phrases, not a sentence with a comma in it.
  if (one.length > 1 && one.every((text, place) => text !== other[place])) return other.join(", ");
  const whole = said(value);
  return whole === value ? other.join(", ") : whole;
}

/** A text where there is one, else what the server said. */
export function known(start, name, otherwise = name) {
  const key = `${start}.${name}`;
  return key in words || key in spare ? t(key) : otherwise;
}

/** Seconds in words: "about 4 min". */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "";
  if (seconds < 60) return t("time.seconds", { n: Math.max(1, Math.round(seconds)) });
  if (seconds < 5400) return t("time.minutes", { n: Math.round(seconds / 60) });
  return t("time.hours", { n: (seconds / 3600).toFixed(1) });
}

/** Bytes in words. */
export function size(bytes, digits = 1) {
  if (bytes < 1e3) return `${bytes} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(0)} kB`;
  return bytes < 1e9 ? `${(bytes / 1e6).toFixed(digits)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
