// The portrait in the middle: our own page of it in a frame, and its colors while a slider is moved.

import { post } from "./api.js";
import { h } from "./dom.js";
import { language, t } from "./i18n.js";
import { state } from "./state.js";

const LONG = 60000; // milliseconds after which a page that isn't ready is given up

export class Stage {
  /** @param {string} name What the frame shows, for those who hear it. */
  constructor(sitter, name) {
    this.sitter = sitter;
    this.name = name;
    this.note = h("p.stage-note.small", { role: "status" });
    this.element = h("div.stage", this.note);
    this.turn = 0;
    this.asked = 0;
  }

  /** What the frame's page gives away, or null before it is ready. */
  get inner() {
    return this.frame?.contentWindow?.lfportrait ?? null;
  }

  close() {
    this.turn++;
    this.stopper?.abort();
    this.coming?.abort();
    this.frame?.remove();
    this.frame = null;
  }

  /**
   * Show a version, or a mix of a style; the old page stays until the new one is ready, and hands
   * its camera on.
   */
  async show(wish) {
    const mine = ++this.turn;
    this.note.textContent = t("stage.wait");
    this.coming?.abort();
    this.coming = new AbortController();
    try {
      const about = await post(`/api/projects/${this.sitter.id}/viewer`, wish, this.coming.signal);
      const frame = h("iframe.coming", { title: this.name, src: about.page });
      this.element.prepend(frame);
      await this.ready(frame, mine);
      if (mine !== this.turn) {
        frame.remove();
        return null;
      }
      Object.assign(this, { about, wish, coarse: false, ends: false });
      this.take(frame);
      return about;
    } catch (error) {
      // A newer wish came, or the screen was left.
      if (error.name === "AbortError") return null;
      throw error;
    } finally {
      if (mine === this.turn) this.note.textContent = "";
    }
  }

  /** Show a page that is there already, of a head that is still being made; whether it is shown. */
  async early(src) {
    const mine = ++this.turn;
    const frame = h("iframe.coming", { title: this.name, src });
    this.element.prepend(frame);
    await this.ready(frame, mine);
    if (mine !== this.turn || !frame.contentWindow?.lfportrait) {
      frame.remove();
      return false;
    }
    this.take(frame);
    return true;
  }

  /** A page that is ready takes the old one's place, and its camera. */
  take(frame) {
    this.dress(frame);
    const old = this.inner;
    if (old && frame.contentWindow.lfportrait) this.copyCamera(old, frame.contentWindow.lfportrait);
    this.frame?.remove();
    this.frame = frame;
    this.more = null;
    frame.classList.remove("coming");
  }

  /** Until the frame's page has drawn, or says that it stands still. */
  ready(frame, mine) {
    return new Promise((done) => {
      const start = performance.now();
      const look = () => {
        const page = frame.contentDocument;
        const over = mine !== this.turn || performance.now() - start > LONG;
        if (over || page?.documentElement?.dataset.ready || page?.body?.classList.contains("standing"))
          done();
        else setTimeout(look, 40);
      };
      look();
    });
  }

  /** The page as a part of ours: its own slider and caption are ours here, its ground follows the theme. */
  dress(frame = this.frame) {
    const page = frame?.contentDocument;
    if (!page?.head) return;
    const { theme } = document.documentElement.dataset;
    const dark = theme === "dark" || (theme === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
    page.documentElement.dataset.ground = dark ? "dark" : "light";
    page.documentElement.lang = language;
    for (const id of ["foot", "open-panel", "ground"]) {
      const part = page.getElementById(id);
      if (part) part.style.display = "none";
    }
  }

  copyCamera(from, to) {
    const { yaw, pitch, zoom, move } = from.orbit;
    Object.assign(to.orbit, { yaw, pitch, zoom, move: [...move] });
    to.viewer.clock = from.viewer.clock;
    to.viewer.touched = from.viewer.touched;
    if (from.orbit.free !== to.orbit.free) to.viewer.unlock(from.orbit.free);
    to.viewer.change(false);
  }

  /** Whether the server gives colors alone: then nothing is loaded again when a mix changes. */
  get live() {
    return Boolean(state.features?.colors) && this.inner !== null && !this.coarse;
  }

  /** Whether the page goes from the photo to the painting itself: one with a mix goes to the mix. */
  get pair() {
    const sets = this.inner?.renderer.header.sets ?? [];
    return !this.more && sets.length > 1 && sets.every(({ kind }) => kind !== "mix");
  }

  /** Strength of the painting alone. */
  strength(value) {
    const { inner } = this;
    if (!this.pair) return false;
    inner.mix.set(value);
    return true;
  }

  /**
   * The colors of mixes, as further color sets of the frame's page, the graphics' both ends.
   * @param {object[]} mixes One or two.
   */
  async colors(mixes) {
    const mine = ++this.asked;
    this.stopper?.abort();
    this.stopper = new AbortController();
    const { signal } = this.stopper;
    const { sets } = await post(
      `/api/projects/${this.sitter.id}/colors`,
      { page: this.about.page, version: this.wish.version, mixes, slot: "colors" },
      signal,
    );
    const { inner } = this;
    if (mine !== this.asked || !inner) return false;
    // A page that had to be made coarser takes no colors: it is packed again.
    this.coarse = sets === null;
    if (this.coarse) return false;
    const { header } = inner.renderer,
      page = this.frame.contentDocument;
    this.more ??= header.sets.length;
    sets.forEach(({ bands, streams, texels }, index) => {
      const number = this.more + index;
      header.sets[number] = { name: "", kind: "mix", bands };
      if (header.texture) header.texture.sets[number] = Boolean(texels);
      const parts = {
        ...Object.fromEntries(Object.entries(streams).map(([band, data]) => [`set${number}.${band}`, data])),
        ...(texels ? { [`texels${number}`]: texels } : {}),
      };
      for (const [name, data] of Object.entries(parts)) {
        page.querySelector(`script[data-stream="${name}"]`)?.remove();
        const kept = page.createElement("script");
        kept.type = "application/octet-stream";
        kept.dataset.stream = name;
        kept.textContent = data;
        page.body.append(kept);
      }
    });
    // What the graphics hold under these numbers is the last slider's.
    await inner.mix.between(this.more, this.more + sets.length - 1, this.share ?? 0, true);
    if (mine !== this.asked) return false;
    this.ends = sets.length === 2;
    if (this.ends) this.between(this.share ?? 0); // it may have been moved since
    return true;
  }

  /** A mix of both ends, at once: a number of the graphics. */
  between(share) {
    this.share = share;
    const { inner } = this;
    if (!this.ends || !inner) return false;
    inner.mix.blend = share;
    inner.renderer.blend = share;
    inner.viewer.mixed();
    return true;
  }

  /** A slider is taken that goes from the photo to the painting. */
  expect() {
    this.inner?.viewer.expect();
  }
}

/** Let two stages be seen from the same place: whichever is moved leads. Returns what ends it. */
export function linkCameras(one, other) {
  let last = "",
    running = true;
  const key = ({ orbit }) =>
    `${orbit.free} ${orbit.yaw.toFixed(5)} ${orbit.pitch.toFixed(5)} ${orbit.zoom.toFixed(4)} ${orbit.move.map((n) => n.toFixed(2)).join(" ")}`;
  const follow = () => {
    if (!running) return;
    const [a, b] = [one.inner, other.inner];
    if (a && b) {
      // Both sway with one clock, so that they differ by their colors alone.
      b.viewer.clock = a.viewer.clock;
      const touched = Math.max(a.viewer.touched, b.viewer.touched);
      a.viewer.touched = b.viewer.touched = touched;
      const leads = key(a) !== last ? [a, b] : key(b) !== last ? [b, a] : null;
      if (leads) {
        const { free, yaw, pitch, zoom, move } = leads[0].orbit;
        Object.assign(leads[1].orbit, { yaw, pitch, zoom, move: [...move] });
        if (free !== leads[1].orbit.free) leads[1].viewer.unlock(free);
        leads[1].viewer.change();
        last = key(leads[0]);
      }
    }
    requestAnimationFrame(follow);
  };
  follow();
  return () => {
    running = false;
  };
}
