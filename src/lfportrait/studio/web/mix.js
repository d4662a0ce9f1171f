// What of the photo and what of the painting is seen: sliders, and their mix as the server takes it.

import { check, fill, h, slider } from "./dom.js";
import { known, t } from "./i18n.js";

export const STEADY = { strength: 1, identity: 0, regions: {}, keep_colors: false, keep: [] };

/** A mix without what is as usual. */
export function plainMix(mix) {
  const whole = { ...STEADY, ...mix };
  const out = {};
  if (whole.strength !== 1) out.strength = whole.strength;
  if (whole.identity) out.identity = whole.identity;
  if (whole.keep_colors) out.keep_colors = true;
  if (whole.keep.length) out.keep = whole.keep;
  const regions = Object.fromEntries(Object.entries(whole.regions).filter(([, value]) => value !== 1));
  if (Object.keys(regions).length) out.regions = regions;
  return out;
}

/** A region's number, whether it has a style of its own or not. */
const strengthOf = (value) => (typeof value === "object" ? (value.strength ?? 1) : (value ?? 1));

export class MixPanel {
  /**
   * @param {object} how `onbegin(ends, name, share)` when a slider is taken, with the mixes at its ends;
   *   `onmove(mix, share)` at each step, `onend(mix)` when it is let go.
   */
  constructor({ onbegin, onmove, onend }) {
    Object.assign(this, { onbegin, onmove, onend });
    this.mix = { ...STEADY };
    this.element = h("div.stack.mix");
  }

  /** Show a mix of a style for a sitter with these regions. */
  show(mix, regions) {
    this.mix = { ...STEADY, ...mix, regions: { ...mix?.regions }, keep: [...(mix?.keep ?? [])] };
    const open = Object.keys(this.mix.regions).length > 0 || this.mix.keep.length > 0;
    this.strength = this.slide("strength", 0, 1, this.mix.strength, (mix_, value) => ({
      ...mix_,
      strength: value,
    }));
    this.identity = this.slide("identity", 0, 1, this.mix.identity, (mix_, value) => ({
      ...mix_,
      identity: value,
    }));
    const keepColors = (kept) => {
      this.mix.keep_colors = kept;
      this.onend(this.mix);
    };
    fill(
      this.element,
      this.strength,
      this.identity,
      check(
        { id: "keep-colors", checked: this.mix.keep_colors, onchange: keepColors },
        h("span", h("code", "keep_colors"), " ", h("span.soft.small", t("mix.keep_colors"))),
      ),
      regions.length > 0 &&
        h(
          "details",
          { open },
          h("summary", t("mix.regions")),
          h(
            "div.stack.regions",
            regions.map((name) => this.region(name)),
          ),
        ),
    );
  }

  slide(name, min, max, value, put, label = null) {
    const one = slider(label ?? name, {
      min,
      max,
      step: 0.01,
      value,
      note: label ? "" : t(`mix.${name}`),
      oninput: (number) => {
        this.take(one, put, min, max);
        this.mix = put(this.mix, number);
        this.onmove(this.mix, (number - min) / (max - min), name);
      },
      onchange: () => {
        this.taken = null;
        this.onend(this.mix);
      },
    });
    one.input.dataset.name = name;
    // The pictures of both ends are on their way before the hand moves.
    for (const event of ["pointerdown", "keydown"]) {
      one.input.addEventListener(event, (pressed) => {
        if (pressed.key === undefined || pressed.key.startsWith("Arrow")) this.take(one, put, min, max);
      });
    }
    // Let go where it was: no change is sent.
    for (const event of ["pointerup", "pointercancel", "blur"]) {
      one.input.addEventListener(event, () => {
        this.taken = null;
      });
    }
    return one;
  }

  take(one, put, min, max) {
    if (this.taken === one) return;
    this.taken = one;
    const share = (Number(one.input.value) - min) / (max - min);
    this.onbegin([put(this.mix, min), put(this.mix, max)], one.input.dataset.name, share);
  }

  /** Strength of a region, and whether it stays as in the photo. */
  region(name) {
    const kept = this.mix.keep.includes(name),
      value = this.mix.regions[name];
    const one = this.slide(
      name,
      0,
      2,
      strengthOf(value),
      (mix, number) => ({
        ...mix,
        regions: {
          ...mix.regions,
          [name]: typeof value === "object" ? { ...value, strength: number } : number,
        },
      }),
      known("region", name, name),
    );
    one.input.disabled = kept;
    const keep = (yes) => {
      const others = this.mix.keep.filter((each) => each !== name);
      this.mix = { ...this.mix, keep: yes ? [...others, name] : others };
      one.input.disabled = yes;
      this.onend(this.mix);
    };
    return h(
      "div.region",
      one,
      check(
        { id: `keep-${name}`, checked: kept, small: true, onchange: keep },
        h("span", t("mix.keep")),
        h("span.unseen", known("region", name, name)),
      ),
    );
  }
}
