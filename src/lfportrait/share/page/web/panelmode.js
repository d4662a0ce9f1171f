// The way into panel mode and out of it: choice of the display, checks, sliders.

const PLACE = {
  size: 0.8, shiftX: 0, shiftY: -0.04, focus: 0, turn: 0, depth: 1, filtered: false,
  continuous: false, step: 0.5, ground: [0, 0, 0],
};

class PanelMode {
  constructor(viewer, stage) {
    this.viewer = viewer;
    this.stage = stage;
    this.display = null;
    this.dialog = find("panel");
    const choice = find("preset");
    for (const { name } of HEADER.displays) choice.append(new Option(name, name));
    choice.addEventListener("change", () => {
      const entries = HEADER.displays.find(({ name }) => name === choice.value);
      if (entries) this.choose(() => makeDisplay(entries));
    });
    find("open-panel").addEventListener("click", () => {
      find("display-file").value = ""; // the same file may have changed, and be chosen again
      this.dialog.showModal();
    });
    find("close-panel").addEventListener("click", () => this.dialog.close());
    find("start-panel").addEventListener("click", () => this.start());
    find("display-file").addEventListener("change", (event) => this.take(event.target.files[0]));
    for (const name of ["focus", "depth", "size"]) {
      find(name).addEventListener("input", () => this.slide(name, Number(find(name).value)));
    }
    find("filtered").addEventListener("change", () => this.slide("filtered", find("filtered").checked));
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      this.take(event.dataTransfer.files[0]);
    });
    document.addEventListener("fullscreenchange", () => {
      // Esc leaves the full screen before the page hears of it.
      if (this.wanted && this.full && !document.fullscreenElement) this.stop();
      this.full = Boolean(document.fullscreenElement);
    });
    addEventListener("resize", () => this.check());
    addEventListener("keydown", (event) => {
      if (!viewer.panel) return;
      if (event.key === "Escape") this.stop();
      const keys = { "[": ["focus", -0.05], "]": ["focus", 0.05], "-": ["depth", -0.1], "+": ["depth", 0.1] };
      const [name, by] = keys[event.key] ?? [];
      if (name) {
        const control = find(name);
        control.value = String(Number(control.value) + by);
        this.slide(name, Number(control.value));
      }
    });
    this.place = { ...PLACE };
    this.describe();
  }

  /** A display file that was dropped or chosen. */
  async take(file) {
    if (!file) return;
    if (file.size > 1e6) return this.choose(() => { throw new UserError("This is not a display file: it is too large."); });
    const text = await file.text();
    this.choose(() => readDisplay(file.name, text));
    find("preset").value = "";
    if (!this.dialog.open) this.dialog.showModal();
  }

  choose(read) {
    try {
      this.display = read();
      this.describe();
    } catch (error) {
      this.display = null;
      this.describe(error instanceof UserError ? error.message : "This is not a display file.");
    }
  }

  describe(problem = "") {
    const { display } = this;
    find("start-panel").disabled = !display;
    find("display-message").textContent = problem || (display
      ? `${display.name}: ${display.width} x ${display.height} pixels, ${display.views} views. ${display.calibrated ? "Calibrated." : "Not calibrated: expect blur and jumps; your panel's own visual.json corrects that."}`
      : "Choose your panel, or drop its visual.json or a display file onto this page.");
  }

  slide(name, value) {
    this.place[name] = value;
    if (this.viewer.panel) this.viewer.panel.place[name] = value;
    this.viewer.change();
  }

  /** Full screen, then the checks, then the coded picture. */
  async start() {
    this.dialog.close();
    if (document.fullscreenEnabled && !document.fullscreenElement) {
      try {
        await this.stage.requestFullscreen();
      } catch {
        // Refused by the browser: the check below tells whether the window is large enough.
      }
    }
    try {
      this.coder = new Panel(this.viewer.renderer, this.display);
    } catch (error) {
      return this.refuse(error instanceof UserError ? error.message : String(error));
    }
    this.wanted = true;
    this.check();
  }

  /** Begin, go on or end, as the window allows. */
  check() {
    if (!this.wanted) return;
    const { viewer, coder } = this;
    const ratio = window.devicePixelRatio || 1;
    const problem = coder.obstacle([Math.round(innerWidth * ratio), Math.round(innerHeight * ratio)], ratio);
    if (problem) return this.refuse(problem);
    document.body.classList.add("coded");
    viewer.panel ??= { coder, place: { ...this.place } };
    viewer.coding = null;
    viewer.change();
    tell("");
  }

  refuse(problem) {
    this.stop();
    tell(`No panel mode: ${problem}`, true);
  }

  stop() {
    this.wanted = false;
    this.coder?.close();
    this.coder = null;
    this.viewer.panel = null;
    this.viewer.coding = null;
    document.body.classList.remove("coded");
    if (document.fullscreenElement) document.exitFullscreen();
    this.viewer.change();
  }
}
