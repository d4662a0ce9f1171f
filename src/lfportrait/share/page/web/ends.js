// A slider's two ends as pictures, and what lies between them at once.
//
// Both ends share their densities, so a pixel's color is the same sum of samples at both: a mix of
// the two pictures is the picture of the mix, but for colors that are clipped. To mix pictures takes
// a few milliseconds at any size, on any device, where a view of the field may take a second.

const QUICK = 12; // milliseconds that a coarse picture, or a strip of a finer one, should take
const FIRST_END = 12; // unit of the first end's picture; the second's follows

class Ends {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.wanted = false; // whether the finest pair is made as soon as there is time
    this.drop();
  }

  /** What was drawn is of another view or of other colors. */
  drop() {
    for (const { name } of this.pairs ?? []) {
      for (const end of [0, 1]) this.viewer.renderer.release(`${name} ${end}`);
    }
    this.key = null;
    this.pairs = []; // coarse to fine: name, size, share, step, and rows drawn of both ends
    this.seen = null; // the pair that was presented last
  }

  /** Begin again if the pictures are not of what is seen now. */
  follow() {
    const { viewer } = this, { renderer, orbit } = viewer;
    const size = viewer.size(1);
    const key = JSON.stringify([orbit.yaw, orbit.pitch, orbit.zoom, orbit.move, viewer.sway(), size,
      renderer.slots, renderer.filled, renderer.painted, window.devicePixelRatio]);
    if (key === this.key) return;
    this.drop();
    this.key = key;
    const quick = viewer.quickShare(QUICK);
    for (const share of [quick, 0.5, 1]) {
      const coarser = this.pairs.at(-1)?.share ?? 0;
      if (share < 1.6 * coarser && share < 1) continue;
      this.pairs.push({
        name: `ends ${this.pairs.length}`, share, size: viewer.size(share),
        step: share < 1 ? viewer.step : 0.5, drawn: 0,
      });
    }
  }

  /** The finest pair that is there, if one is. */
  get shown() {
    return this.pairs.findLast(({ size, drawn }) => drawn >= 2 * size[1]);
  }

  get whole() {
    return Boolean(this.shown) && this.shown === this.pairs.at(-1);
  }

  /** Whether there is a pair that is finer than the one on the canvas, or the first. */
  get finer() {
    return Boolean(this.shown) && this.shown !== this.seen;
  }

  /** Draw the ends on: the first pair at once, of the finer ones a strip. */
  draw() {
    const { viewer } = this, [first] = this.pairs;
    const pair = this.pairs.find(({ size, drawn }) => drawn < 2 * size[1]);
    if (!pair) return;
    do {
      const row = viewer.pace * pair.size[0] * (pair.step < 1 ? 1 : COARSE); // milliseconds
      this.strip(pair, pair === first ? pair.size[1] : Math.max(4, Math.round(row ? QUICK / row : viewer.strip / 2)));
    } while (pair === first && pair.drawn < 2 * pair.size[1]);
    // What waits for the device would hold up the next mix.
    viewer.wait();
  }

  /** Rows of one of the two ends of a pair. */
  strip(pair, most) {
    const { viewer } = this, { renderer } = viewer, { gl, blend } = renderer;
    const height = pair.size[1], end = Math.floor(pair.drawn / height), since = pair.drawn % height;
    const rows = [since, Math.min(most, height - since)];
    const camera = viewer.orbit.camera(
      pair.size, pair.share * (window.devicePixelRatio || 1), viewer.sway());
    gl.bindFramebuffer(gl.FRAMEBUFFER, renderer.target(`${pair.name} ${end}`, pair.size));
    renderer.blend = end;
    renderer.view(camera, pair.size, { step: pair.step, jitter: [0, pair.step < 1 ? 0 : 1], rows });
    renderer.blend = blend;
    pair.drawn += rows[1];
  }

  /** Put the mix onto the canvas, of the finest pair that is there. */
  present() {
    const { renderer } = this.viewer, { gl, canvas } = renderer;
    const pair = this.shown;
    this.seen = pair;
    const { program, at } = renderer.program("mixed");
    gl.useProgram(program);
    ["firstEnd", "secondEnd"].forEach((sampler, end) => {
      gl.activeTexture(gl.TEXTURE0 + FIRST_END + end);
      gl.bindTexture(gl.TEXTURE_2D, renderer.targets[`${pair.name} ${end}`].texture);
      for (const side of ["MIN", "MAG"]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${side}_FILTER`], gl.LINEAR);
      for (const name of ["WRAP_S", "WRAP_T"]) {
        gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl.CLAMP_TO_EDGE);
      }
      gl.uniform1i(at(sampler), FIRST_END + end);
    });
    gl.uniform1f(at("blend"), renderer.blend);
    gl.uniform2fv(at("size"), [canvas.width, canvas.height]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    renderer.draw([canvas.width, canvas.height]);
  }
}
