// Photos on their way to the server: four at a time, gone on with by their hash, each one's state known.

import { post, stream } from "./api.js";
import { said, t } from "./i18n.js";

const STREAMS = 4;
const READ = 2; // files that a stream reads ahead
const LARGEST_HASHED = 2 ** 30; // bytes; the digest needs a file in memory as a whole
const WAITS = [1, 2, 5, 10, 20, 30]; // seconds before it is tried again

const sitters = new Map();
/** The uploads of a sitter; they go on while other screens are seen. */
export function uploadsOf(id) {
  if (!sitters.has(id)) sitters.set(id, new Uploads(id));
  return sitters.get(id);
}

addEventListener("beforeunload", (event) => {
  if ([...sitters.values()].some((each) => each.busy)) event.preventDefault();
});

const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));

async function digest(file) {
  if (file.size > LARGEST_HASHED) return null;
  const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer()));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

const LONGEST = 100; // signs of a name without its ending

/** A file's name as every system takes it: signs that only some know become a dash, what is too long is cut. */
export function plainName(name) {
  const [, stem, ending] = /^(.*?)(\.[^.]*)?$/s.exec(name.normalize("NFC"));
  // Also signs that are not seen, as between the people of one emoji.
  const plain = stem.replace(/[\p{C}/\\:*?"<>|]+/gu, "-").trim();
  return `${[...plain].slice(0, LONGEST).join("").trim() || "-"}${ending ?? ""}`;
}

class Uploads {
  constructor(project) {
    this.project = project;
    this.items = []; // {file, name, size, state, sent, error}
    this.listeners = new Set();
    this.stopper = new AbortController();
  }

  get busy() {
    return this.items.some(({ state }) => ["waiting", "reading", "sending", "again"].includes(state));
  }

  /** Files, bytes and what became of them. */
  figures() {
    const count = (...states) => this.items.filter(({ state }) => states.includes(state)).length;
    return {
      total: this.items.length,
      done: count("done", "have"),
      wrong: this.items.filter(({ state }) => state === "wrong"),
      have: count("have"),
      again: count("again"),
      bytes: this.items.reduce((sum, { size }) => sum + size, 0),
      sent: this.items.reduce((sum, { sent }) => sum + sent, 0),
    };
  }

  watch(act) {
    this.listeners.add(act);
    return () => this.listeners.delete(act);
  }

  changed() {
    // Several streams tell of each packet: a picture a frame is enough.
    this.frame ??= setTimeout(() => {
      this.frame = null;
      for (const act of this.listeners) act(this);
    }, 60);
  }

  /** Add files, and begin if nothing is on its way. */
  add(files) {
    if (!this.busy) this.items = [];
    const there = new Set(this.items.map(({ name, size }) => `${name} ${size}`));
    for (const file of files) {
      if (file.name.startsWith(".") || /^(thumbs\.db|desktop\.ini)$/i.test(file.name)) continue;
      if (there.has(`${file.name} ${file.size}`)) continue;
      this.items.push({ file, name: file.name, size: file.size, state: "waiting", sent: 0, error: "" });
    }
    this.changed();
    this.running ??= this.run().finally(() => {
      this.running = null;
      this.changed();
    });
    return this.running;
  }

  stop() {
    this.stopper.abort();
    this.stopper = new AbortController();
    // What a stream has read ahead is not sent either.
    for (const item of this.items) if (item.state === "reading") item.state = "stopped";
    this.items = this.items.filter(({ state }) => ["done", "have", "wrong"].includes(state));
    this.changed();
  }

  async run() {
    const workers = Array.from({ length: STREAMS }, () => this.work());
    await Promise.all(workers);
  }

  /** One stream: takes files, reads some ahead, sends them. */
  async work() {
    for (;;) {
      const mine = this.items.filter(({ state }) => state === "waiting").slice(0, READ);
      if (!mine.length) return;
      for (const item of mine) item.state = "reading";
      for (const item of mine) {
        try {
          item.hash = await digest(item.file);
        } catch {
          this.wrong(item, t("upload.unread"));
        }
      }
      for (const item of mine) {
        if (item.state === "reading") await this.deliver(item);
      }
    }
  }

  wrong(item, text) {
    Object.assign(item, { state: "wrong", error: text });
    this.changed();
  }

  /** Bring one file over, however often the line breaks. */
  async deliver(item) {
    const { signal } = this.stopper;
    for (let turn = 0; !signal.aborted; turn++) {
      try {
        if (await this.send(item, signal)) return;
      } catch (error) {
        if (error.name === "AbortError") return;
        const passing = error.status === 0 || ["too_slow", "busy", "exists", "bad_hash"].includes(error.code);
        const often = error.status === 0 ? Infinity : WAITS.length;
        if (!passing || turn >= often) return this.wrong(item, error.message);
        item.state = "again";
        this.changed();
        await wait(WAITS[Math.min(turn, WAITS.length - 1)]);
      }
    }
  }

  async send(item, signal) {
    const about = { name: plainName(item.name), size: item.size, sha256: item.hash };
    const [answer] = (await post(`/api/projects/${this.project}/uploads`, { files: [about] }, signal)).files;
    if (answer.state === "refused") {
      this.wrong(item, said(answer.error.message));
      return true;
    }
    if (answer.state === "have") {
      Object.assign(item, { state: "have", sent: item.size });
      this.changed();
      return true;
    }
    item.state = "sending";
    item.sent = answer.offset;
    await stream(
      `/api/projects/${this.project}/uploads/${answer.upload}?offset=${answer.offset}`,
      item.file.slice(answer.offset),
      (sent) => {
        item.sent = Math.min(answer.offset + sent, item.size);
        this.changed();
      },
      signal,
    );
    Object.assign(item, { state: "done", sent: item.size, file: null });
    this.changed();
    return true;
  }
}

/** All files of a drop, those in folders, too. */
export async function droppedFiles(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files];
  const files = [];
  const walk = async (entry) => {
    if (entry.isFile) {
      files.push(await new Promise((done, failed) => entry.file(done, failed)));
      return;
    }
    const reader = entry.createReader();
    for (;;) {
      // A reader gives a hundred at a time.
      const some = await new Promise((done, failed) => reader.readEntries(done, failed));
      if (!some.length) return;
      for (const each of some) await walk(each);
    }
  };
  for (const entry of entries) await walk(entry);
  return files.sort((one, other) => one.name.localeCompare(other.name, "en", { numeric: true }));
}
