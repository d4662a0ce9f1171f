// Panel mode: the portrait coded for a light-field panel, one ray for each sub-pixel, live.

class Panel {
  constructor(renderer, display) {
    this.renderer = renderer;
    this.display = display;
    this.numbers = panelNumbers(display);
    const { gl } = renderer;
    const longest = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (Math.max(display.width, display.height) > longest) {
      throw new UserError(`This device's graphics draw at most ${longest} pixels in a row; ${display.name} has more.`);
    }
    this.phases = [[4, this.numbers.columns], [5, this.numbers.rows]].map(([unit, values]) => {
      const texture = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32F, values.length, 1);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, values.length, 1, gl.RED, gl.FLOAT, values);
      for (const name of ["MIN", "MAG"]) {
        gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}_FILTER`], gl.NEAREST);
      }
      return texture;
    });
  }

  /** Give the textures back. */
  close() {
    for (const texture of this.phases) this.renderer.gl.deleteTexture(texture);
  }

  /**
   * Why the window can't show this panel's picture pixel for pixel; empty where it can.
   * @param {number[]} size Of the window in its own pixels.
   */
  obstacle([width, height], ratio) {
    const { display } = this;
    if (Math.abs(ratio - 1) > 1e-3) {
      return `The page is scaled: ${Math.round(100 * ratio)} % (zoom of the page and scaling of the desktop). A panel needs 100 %: press Ctrl 0, and set the desktop's scaling of this screen to 100 %.`;
    }
    if (width !== display.width || height !== display.height) {
      return `${display.name} has ${display.width} x ${display.height} pixels, this window ${width} x ${height}. Move the window onto the panel and make it full screen.`;
    }
    return "";
  }

  /** The ground behind the head, as lightfield/ground.py has it. */
  drawGround(at, place, perUnit, reach) {
    const { renderer, display } = this;
    const { gl } = renderer;
    const { back, behind, blur } = renderer.header.ground;
    const depth = Math.max(behind - (perUnit * back * place.depth + place.focus), 0);
    const share = depth / display.distance;
    const rays = 2 / display.height * Math.sqrt(Math.max(display.pitch / 3, 1)) * (1 + share);
    // What a panel can't tell apart at that depth would break into a comb.
    const soft = blur * 2 * reach / display.pitch * share / Math.sqrt(12);
    const level = Math.log2(Math.max(rays, soft) / perUnit * renderer.groundPixels);
    renderer.ground(at, { depth: depth / place.depth / perUnit, level: Math.max(level, 0) });
    gl.uniform2f(at("groundMoved"), place.shiftX, place.shiftY);
  }

  /**
   * Draw the coded picture, or some rows of it, into the framebuffer that is bound.
   * @param {object} place `size`, `shiftX`, `shiftY`, `focus`, `turn` (radians), `depth`,
   *   `filtered`, `continuous`, `step`, `ground`, `rows`: see lightfield/placement.py.
   */
  draw(place) {
    const { renderer, display, numbers } = this;
    const { gl } = renderer;
    const aspect = display.width / display.height;
    const perUnit = Math.min(place.size, place.size * aspect * 1.15);
    // A view's rays are a row apart downwards and a lens across.
    const footprint = 2 / display.height * Math.sqrt(Math.max(display.pitch / 3, 1)) / perUnit;
    const at = renderer.begin("panel", place.step, footprint);
    // Flattening space about the panel, eyes included, changes no picture: the head keeps its shape
    // and the eyes and its place are those before the flattening.
    const distance = display.distance / place.depth;
    const reach = display.distance * Math.tan(display.cone * Math.PI / 360);
    const shift = [place.shiftX, place.shiftY, place.focus / place.depth];
    const c = Math.cos(place.turn), s = Math.sin(place.turn);
    const world = [[c, 0, -s], [0, 1, 0], [s, 0, c]]; // rows
    const lattice = world.map((row, axis) => row.map((v) => v * renderer.scale[axis] / perUnit));
    const moved = lattice.map((row, axis) => renderer.shift[axis]
      - row.reduce((sum, value, i) => sum + value * shift[i], 0));
    const columns = (rows) => [0, 1, 2].flatMap((i) => rows.map((row) => row[i]));
    this.phases.forEach((texture, number) => {
      gl.activeTexture(gl.TEXTURE0 + 4 + number);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.uniform1i(at("columnPhase"), 4);
    gl.uniform1i(at("rowPhase"), 5);
    gl.uniform1fv(at("subpixelStep"), numbers.steps);
    gl.uniform1fv(at("subpixelMoved"), numbers.moved);
    gl.uniform2iv(at("panelSize"), [display.width, display.height]);
    gl.uniform2iv(at("mirrored"), [Number(display.flip_x), Number(display.flip_y)]);
    gl.uniform1f(at("views"), display.views);
    gl.uniform1f(at("pitch"), display.pitch);
    gl.uniform1i(at("inverted"), Number(display.inverted));
    gl.uniform1i(at("reversed"), Number(display.subpixels === "BGR"));
    gl.uniform1i(at("continuous"), Number(place.filtered || place.continuous));
    gl.uniform1f(at("eyeReach"), reach);
    gl.uniform1f(at("eyeHeight"), display.eye_height);
    gl.uniform1f(at("eyeDistance"), distance);
    gl.uniform1f(at("perUnit"), perUnit);
    gl.uniformMatrix3fv(at("toLattice"), false, columns(lattice));
    gl.uniform3fv(at("latticeShift"), moved);
    gl.uniformMatrix3fv(at("toWorld"), false, columns(world));
    gl.uniform1i(at("rays"), place.filtered ? 3 : 1);
    gl.uniform1f(at("gamma"), display.gamma);
    gl.uniform3fv(at("ground"), place.ground);
    if (renderer.header.ground) this.drawGround(at, place, perUnit, reach);
    renderer.draw([display.width, display.height], place.rows);
  }
}
