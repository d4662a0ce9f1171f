// Talking to the server: JSON there and back, one kind of error, bytes where they are pictures.

import { known, said } from "./i18n.js";

const SAID = [
  "no_session",
  "refused",
  "too_slow",
  "disk_full",
  "preview_lost",
  "internal",
  "bad_hash",
];

/** What the server refused, with a sentence for the person at the page. */
export class ApiError extends Error {
  constructor(status, { code = "internal", message = "", about = {} } = {}) {
    super(SAID.includes(code) ? known("error", code, said(message)) : said(message) || known("error", code));
    Object.assign(this, { status, code, about });
  }
}

const watchers = [];
/** Call `act` with whether the server can be reached, when that changes. */
export function watchLine(act) {
  watchers.push(act);
}
let online = true;
export function reached(yes) {
  if (yes === online) return;
  online = yes;
  for (const act of watchers) act(yes);
}

async function refused(answer) {
  const { error } = await answer.json().catch(() => ({ error: {} }));
  return new ApiError(answer.status, error);
}

async function request(path, how = {}) {
  let answer;
  try {
    answer = await fetch(path, { credentials: "same-origin", ...how });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    reached(false);
    throw new ApiError(0, { code: "offline" });
  }
  reached(true);
  if (!answer.ok) throw await refused(answer);
  return answer;
}

// What the screen that is seen waits for.
let screen = new AbortController();
/** Give up what the screen that is left has asked for and not got: the server drops it, too. */
export function leaveScreen() {
  screen.abort();
  screen = new AbortController();
}

/** GET of JSON, for the screen that is seen; null for no signal. */
export async function get(path, signal = screen.signal) {
  return (await request(path, { signal })).json();
}

/** Another method with a JSON body; the answer's JSON. */
export async function send(method, path, body = {}, signal = undefined) {
  return (await sent(method, path, JSON.stringify(body), "application/json", signal)).json();
}

export const post = (path, body, signal) => send("POST", path, body, signal);

/** Bytes as a body; the answer's JSON. */
export async function put(path, bytes) {
  return (await sent("PUT", path, bytes, "application/octet-stream")).json();
}

/** A picture that the server draws from a JSON body, for the screen that is seen. */
export async function picture(path, body, signal = screen.signal) {
  const answer = await sent("POST", path, JSON.stringify(body), "application/json", signal);
  const image = await createImageBitmap(await answer.blob());
  return { image, seconds: Number(answer.headers.get("X-Lfportrait-Seconds")) };
}

function sent(method, path, body, type, signal = undefined) {
  return request(path, { method, body, signal, headers: { "Content-Type": type, "X-Lfportrait": "1" } });
}

/** A stored picture, drawn into a canvas or read from it. */
export async function bitmap(path, signal = screen.signal) {
  const answer = await request(path, { signal });
  return createImageBitmap(await answer.blob(), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}

/**
 * Send the bytes of a file from `offset` on, saying how far it is.
 * @returns {Promise<object>} The answer's JSON.
 */
export function stream(path, blob, onprogress, signal) {
  return new Promise((done, failed) => {
    // fetch tells nothing of an upload's progress.
    const asked = new XMLHttpRequest();
    asked.open("PUT", path);
    asked.setRequestHeader("Content-Type", "application/octet-stream");
    asked.setRequestHeader("X-Lfportrait", "1");
    asked.responseType = "json";
    asked.upload.onprogress = (event) => onprogress(event.loaded);
    asked.onload = () =>
      asked.status < 300 ? done(asked.response) : failed(new ApiError(asked.status, asked.response?.error));
    asked.onerror = () => failed(new ApiError(0, { code: "offline" }));
    asked.onabort = () => failed(new DOMException("stopped", "AbortError"));
    signal?.addEventListener("abort", () => asked.abort());
    asked.send(blob);
  });
}
