// Pictures one after another: coarse while something moves, every pixel when it stands still.

const WANTED = 1000 / 50; // milliseconds for a frame that is fast enough
const TOO_LONG = 1000 / 34;
const SWAY = 0.2; // radians to each side
const PERIOD = 9000; // milliseconds there and back
const REST = 6000; // milliseconds after which the head begins to sway again
const STRIP = 24; // milliseconds that a strip of a still picture should take
const COARSE = 0.6; // time of a sample of a coarse picture, over that of a still one, at least
const PAUSE = 300; // milliseconds after which a slider is taken to stand still

class Viewer {
  constructor(renderer, orbit, calm) {
    this.renderer = renderer;
    this.orbit = orbit;
    this.calm = calm; // no motion of its own
    this.share = 0.4; // of the canvas' pixels along a side while it moves
    this.touched = performance.now();
    this.clock = 0; // of the sway
    this.step = 1;
    this.still = 0; // rows of the still picture that are drawn
    this.strip = 32;
    this.drawn = 0;
    this.took = 0; // milliseconds, for the strips of a still picture
    this.pace = 0; // milliseconds a pixel of the last one
    this.panel = null;
    this.running = false;
    this.tilt = [0, 0];
    this.waiters = [];
    this.ends = new Ends(this);
    this.mixing = false;
    this.slid = 0; // when a slider was moved last
  }

  /** Something has changed: draw again. `hand` where a person did it. */
  change(hand = true) {
    if (hand) this.touched = performance.now();
    this.still = 0;
    this.moved = true;
    this.mixing = false;
    this.ends.drop();
    this.ends.wanted = false;
    this.wake();
  }

  /** A hand has moved a slider: the share of the two color sets has changed, and nothing else. */
  mixed() {
    if (!this.between) return this.change();
    this.touched = this.slid = performance.now();
    // The view is not there yet: it comes first.
    if (this.moved) this.change();
    else this.mixing = true;
    this.still = 0;
    this.ends.wanted = true;
    this.wake();
  }

  /** A hand is at a slider: what it may show is made before it moves, if there is time. */
  expect() {
    if (!this.between) return;
    this.touched = performance.now();
    this.ends.wanted = true;
    this.wake();
  }

  /** Whether there are two color sets to mix in a view. */
  get between() {
    const [first, second] = this.renderer.slots;
    return !this.panel && first !== null && second !== null && first !== second;
  }

  /** Let a head from one photo be turned all around, or no further than it is good. */
  unlock(free) {
    const { orbit } = this;
    orbit.free = free;
    find("around").setAttribute("aria-pressed", String(free));
    if (!free && orbit.limit) orbit.yaw = Math.atan2(Math.sin(orbit.yaw), Math.cos(orbit.yaw));
    orbit.turn(0, 0); // back to where it is good
    this.change();
  }

  wake() {
    if (this.running || this.stopped) return;
    this.running = true;
    this.last = 0;
    requestAnimationFrame((time) => this.frame(time));
  }

  /** Canvas as large as the window's pixels. */
  resize() {
    const { canvas } = this.renderer;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width === width && canvas.height === height) return;
    canvas.width = width;
    canvas.height = height;
    this.change(false);
  }

  swaying(time) {
    return !this.calm && !this.hold && !document.hidden && time - this.touched > REST;
  }

  frame(time) {
    this.running = false;
    if (this.stopped || document.hidden || this.renderer.gl.isContextLost()) return;
    const passed = this.last ? Math.min(time - this.last, 1000) : 0;
    this.last = time;
    this.resize();
    document.body.classList.toggle("near", this.orbit.zoom > 1.1);
    const sways = this.swaying(time);
    if (sways) this.clock += Math.min(passed, 100);
    let more;
    if (this.panel) more = this.framePanel(sways);
    else if (sways || this.moved) more = this.frameMoving(sways, passed);
    else if (this.mixing || (this.ends.wanted && time - this.slid < PAUSE)) more = this.frameMixed();
    else more = this.frameStill() || this.frameEnds();
    this.drawn++;
    this.waiters = this.waiters.filter((waiter) => !waiter());
    if (more || sways) {
      this.running = true;
      requestAnimationFrame((next) => this.frame(next));
    } else if (!this.calm) {
      clearTimeout(this.alarm);
      this.alarm = setTimeout(() => this.wake(), Math.max(50, this.touched + REST + 50 - time));
    }
  }

  sway() {
    return SWAY * Math.sin(2 * Math.PI * this.clock / PERIOD) + this.tilt[0];
  }

  size(share) {
    const { canvas } = this.renderer;
    return [canvas.width, canvas.height].map((n) => Math.max(1, Math.round(n * share)));
  }

  /** The share of the canvas' sides at which a coarse picture takes so many milliseconds. */
  quickShare(milliseconds) {
    if (!this.pace) return this.share;
    const [width, height] = this.size(1);
    return Math.min(1, Math.max(0.15, Math.sqrt(milliseconds / (COARSE * this.pace * width * height))));
  }

  /** A coarse picture; its size follows the time that the last ones took. */
  frameMoving(sways, passed) {
    const { renderer } = this;
    // The first of several: no larger than the still picture's time allows.
    if (!this.measured) this.share = Math.min(this.share, Math.max(0.2, this.quickShare(TOO_LONG)));
    if (passed && this.measured) {
      this.time = this.time ? 0.8 * this.time + 0.2 * passed : passed;
      if (this.time > TOO_LONG || passed > 200) {
        this.share = Math.max(0.2, this.share * Math.max(0.6, Math.sqrt(WANTED / Math.max(this.time, passed * 0.5))));
        this.time = 0;
      } else if (this.time < WANTED && this.share < 1) {
        this.share = Math.min(1, this.share * 1.05);
      }
    }
    this.measured = true;
    const size = this.size(this.share);
    const frame = renderer.target("moving", size);
    renderer.gl.bindFramebuffer(renderer.gl.FRAMEBUFFER, frame);
    const camera = this.orbit.camera(size, this.share * (window.devicePixelRatio || 1), this.sway());
    renderer.view(camera, size, { step: this.step, jitter: [0, 1] });
    renderer.present(frame, size);
    this.still = 0;
    if (!sways) this.moved = false;
    return true;
  }

  /** A strip of the still picture, at every pixel and with half-voxel steps. */
  frameStill() {
    const { renderer } = this;
    const { gl } = renderer;
    this.measured = false;
    const size = this.size(1);
    if (this.still >= size[1]) return false;
    if (this.still === 0) this.took = 0;
    const frame = renderer.target("still", size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const rows = [this.still, Math.min(this.strip, size[1] - this.still)];
    const camera = this.orbit.camera(size, window.devicePixelRatio || 1, this.sway());
    this.timed(rows, size, () => renderer.view(camera, size, { rows }));
    this.still += rows[1];
    if (this.still < size[1]) return true;
    renderer.present(frame, size);
    this.pace = this.took / (size[0] * size[1]);
    return false;
  }

  /** What lies between a slider's ends; they become finer meanwhile. */
  frameMixed() {
    const { ends } = this;
    this.measured = false;
    ends.follow();
    if (!ends.shown || !this.mixing) ends.draw();
    if (this.mixing || ends.finer) ends.present();
    this.mixing = false;
    return true;
  }

  /** A strip of the ends of a slider that a hand is at. */
  frameEnds() {
    if (!this.ends.wanted || !this.between) return false;
    this.ends.follow();
    if (this.ends.whole) return false;
    this.ends.draw();
    return true;
  }

  /** Wait until all is drawn. */
  wait(row = 0) {
    const { gl } = this.renderer;
    gl.readPixels(0, row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** Draw a strip, wait for it, and choose the next one's height by the time it took. */
  timed(rows, size, draw) {
    const start = performance.now();
    draw();
    this.wait(rows[0]);
    const took = Math.max(performance.now() - start, 1);
    this.took += took;
    const height = Math.round(this.strip * Math.min(2, STRIP / took));
    this.strip = Math.min(Math.max(height, 4), size[1]);
  }

  /**
   * Some strips of the coded picture, which goes onto the panel as a whole: a driver takes the
   * picture away from a page that draws for seconds at a stretch.
   */
  framePanel(sways) {
    const { renderer, panel } = this;
    const { gl } = renderer;
    const size = [panel.coder.display.width, panel.coder.display.height];
    if (!this.coding) {
      if (!sways && !this.moved) return false;
      this.moved = false;
      this.coding = { rows: 0, place: { ...panel.place, turn: panel.place.turn + this.sway() } };
    }
    const { coding } = this;
    const frame = renderer.target("coded", size);
    const start = performance.now();
    while (coding.rows < size[1] && performance.now() - start < 2 * STRIP) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      const rows = [coding.rows, Math.min(this.strip, size[1] - coding.rows)];
      this.timed(rows, size, () => panel.coder.draw({ ...coding.place, rows }));
      coding.rows += rows[1];
    }
    if (coding.rows < size[1]) return true;
    renderer.present(frame, size);
    this.coding = null;
    document.documentElement.dataset.coded = panel.coder.display.name;
    return this.moved;
  }

  /** Resolves when the still picture is on the canvas. */
  async settled() {
    this.change(false);
    await new Promise((done) => {
      this.waiters.push(() => {
        const ready = !this.moved && this.still >= this.renderer.canvas.height;
        if (ready || this.stopped) done();
        return ready || this.stopped;
      });
    });
  }
}
