// Buttons, slider, caption, messages: everything that is not the picture.

const find = (name) => document.getElementById(name);

/** Tell something below the picture; an empty text takes it away. */
function tell(text, stays = false) {
  const message = find("message");
  message.textContent = text;
  message.hidden = !text;
  clearTimeout(tell.timer);
  if (text && !stays) tell.timer = setTimeout(() => tell(""), 7000);
}

/** Which color sets are mixed, and how: the slider, and the buttons of the styles. */
class Mix {
  constructor(renderer, viewer) {
    this.renderer = renderer;
    this.viewer = viewer;
    this.sets = renderer.header.sets;
    this.style = this.sets.length > 1 ? 1 : 0;
    this.blend = this.sets.length > 1 ? 1 : 0;
    this.ends = null; // other color sets in the place of the photo and the painting
    const slider = find("blend");
    find("mix").hidden = this.sets.length < 2;
    slider.value = String(1000 * this.blend);
    slider.addEventListener("input", () => this.set(Number(slider.value) / 1000));
    for (const event of ["pointerenter", "focus"]) slider.addEventListener(event, () => viewer.expect());
    const styles = find("styles");
    styles.hidden = this.sets.length < 3;
    this.sets.forEach(({ name }, number) => {
      if (number === 0) return;
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name;
      button.setAttribute("aria-pressed", String(number === this.style));
      button.addEventListener("click", () => this.choose(number));
      styles.append(button);
    });
  }

  async set(blend) {
    this.blend = blend;
    this.ends = null;
    const painting = this.sets[this.style].name;
    find("blend").setAttribute("aria-valuetext", `${Math.round(100 * blend)} % ${painting}`);
    await this.apply(false, true);
  }

  /**
   * From one color set to another, whatever they are.
   * @param {boolean} fresh Read them again: under these numbers there were others.
   */
  between(first, second, blend, fresh = false) {
    this.blend = blend;
    this.ends = [first, second];
    this.fresh ||= fresh;
    return this.apply(true);
  }

  async choose(number) {
    this.style = number;
    this.ends = null;
    [...find("styles").children].forEach((button, index) => {
      button.setAttribute("aria-pressed", String(index + 1 === number));
    });
    if (this.blend === 0) {
      this.blend = 1;
      find("blend").value = "1000";
    }
    await this.apply();
  }

  /**
   * Put it into the textures and draw again. What is asked for while one is read comes next, and of
   * several the last.
   * @param {boolean} slid A slider was moved: nothing but the share of both has changed.
   */
  apply(all = false, slid = false) {
    this.slid = slid && (this.slid || !this.busy);
    const ends = this.ends ?? [0, this.sets.length > 1 ? this.style : 0];
    this.wanted = [...ends, this.blend, all];
    this.busy ??= this.follow().finally(() => {
      this.busy = null;
      if (this.slid) this.viewer.mixed();
      else this.viewer.change(false);
    });
    return this.busy;
  }

  async follow() {
    let done = null;
    while (done !== this.wanted) {
      done = this.wanted;
      if (this.fresh) this.renderer.slots = [null, null];
      this.fresh = false;
      await this.renderer.show(...done);
    }
  }
}

/** The buttons in the corner. */
function tools(viewer, stage) {
  const press = (name, act) => find(name).addEventListener("click", act);
  const root = document.documentElement, first = root.dataset.ground;
  press("ground", () => {
    const { renderer } = viewer;
    // From a painted ground to plain ones, and back.
    if (renderer.painted) renderer.painted = false;
    else {
      root.dataset.ground = root.dataset.ground === "dark" ? "light" : "dark";
      renderer.painted = Boolean(renderer.header.ground) && root.dataset.ground === first;
    }
    find("ground").setAttribute("aria-pressed", String(root.dataset.ground === "light"));
    viewer.change();
  });
  const around = find("around");
  around.hidden = !viewer.orbit.start.limit;
  press("around", () => viewer.unlock(!viewer.orbit.free));
  press("picture", () => keepPicture(viewer));
  const full = find("full");
  full.hidden = !document.fullscreenEnabled;
  press("full", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else stage.requestFullscreen();
  });
  document.addEventListener("keydown", (event) => {
    const typing = event.target instanceof HTMLInputElement && event.target.type !== "range";
    if (event.ctrlKey || event.metaKey || event.altKey || typing) return;
    const buttons = { a: "around", f: "full", g: "ground", s: "picture", p: "open-panel" };
    const button = buttons[event.key] && find(buttons[event.key]);
    if (button && !button.hidden && !document.querySelector("dialog[open]")) button.click();
  });
  // The controls make room for the portrait while nobody moves.
  let timer = 0;
  const awake = () => {
    document.body.classList.remove("idle");
    clearTimeout(timer);
    timer = setTimeout(() => {
      const busy = document.querySelector("dialog[open], .bar :focus-visible, .bar:hover");
      document.body.classList.toggle("idle", !busy);
    }, 4000);
  };
  for (const name of ["pointermove", "pointerdown", "keydown", "focusin"]) {
    addEventListener(name, awake, { passive: true });
  }
  awake();
}

/** Save what is seen as a PNG file, at every pixel of the window, on its ground. */
async function keepPicture(viewer) {
  await viewer.settled();
  const { canvas } = viewer.renderer;
  const copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  const context = copy.getContext("2d");
  context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--ground");
  context.fillRect(0, 0, copy.width, copy.height);
  context.drawImage(canvas, 0, 0);
  copy.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    const words = document.title.toLowerCase().match(/[\p{L}\p{N}]+/gu) ?? ["portrait"];
    link.download = `${words.join("-")}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }, "image/png");
}
