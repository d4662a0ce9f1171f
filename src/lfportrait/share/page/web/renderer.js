// WebGL2: the textures of a portrait, and its pictures.

const CORNERS = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`;

/** A 16-bit float with the value of a number from -65504 to 65504. */
function half(value) {
  const bits = new Uint32Array(new Float32Array([value]).buffer)[0];
  const sign = bits >>> 16 & 0x8000;
  const exponent = (bits >> 23 & 255) - 112;
  if (exponent >= 31) return sign | 0x7bff;
  if (exponent > 0) {
    const rounded = (exponent << 10 | bits >> 13 & 1023) + (bits >> 12 & 1);
    return sign | Math.min(rounded, 0x7bff);
  }
  return sign | Math.round(Math.abs(value) * 2 ** 24);
}

/** Units of the textures of the surface; 4 and 5 are a panel's, 6 is drawn into. */
const CELLS = 7, CHARTS = 8, TEXELS = 9, GROUND = 11;

/** Width in pixels of the texture's detail in a view, as in field/grid.py. */
const DETAIL = 1.6;

/** So far from straight on one sees the ground as it stands; beyond, it turns along. */
const ASIDE = 40 * Math.PI / 180, ABOVE = 25 * Math.PI / 180;

/**
 * The frame of the ground for an eye: the world's own, or turned after the eye, so that there is a
 * ground behind the head from all sides. From behind, one looks straight at it again.
 * @param {number[]} away From what is looked at to the eye.
 * @returns {number[]} World to ground, [9] by columns.
 */
function groundFrame([x, y, z]) {
  const yaw = Math.atan2(x, z), pitch = Math.atan2(y, Math.hypot(x, z));
  const far = Math.abs(yaw);
  const aside = far <= ASIDE ? yaw : Math.sign(yaw) * ASIDE * (Math.PI - far) / (Math.PI - ASIDE);
  const above = Math.min(Math.max(pitch, -ABOVE), ABOVE);
  // Rows of the eye's frame in the world, and, transposed, of the eye's in the ground's.
  const frame = (turn, rise) => {
    const c = Math.cos(turn), s = Math.sin(turn), u = Math.cos(rise), v = Math.sin(rise);
    return [[c, 0, -s], [-s * v, u, -c * v], [s * u, v, c * u]];
  };
  const world = frame(yaw, pitch), own = frame(aside, above);
  return [0, 1, 2].flatMap((column) => [0, 1, 2].map((row) => own.reduce(
    (sum, axis, i) => sum + axis[row] * world[i][column], 0)));
}

class Renderer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} header Of the page.
   */
  constructor(canvas, header) {
    this.canvas = canvas;
    this.header = header;
    this.bands = header.sets[0].bands.length;
    const gl = canvas.getContext("webgl2", {
      alpha: true, antialias: false, depth: false, stencil: false, premultipliedAlpha: true,
      preserveDrawingBuffer: true, powerPreference: "high-performance",
    });
    if (!gl) throw new UserError("This browser has no WebGL2, which the moving portrait needs. This is a still picture of it.");
    this.gl = gl;
    this.forget();
    this.blend = 0;
    const [depth, height, width] = header.shape;
    this.points = [width, height, depth];
    this.scale = this.points.map((n, axis) => n / (2 * header.radius[axis]));
    this.shift = this.points.map((n, axis) => n / 2 - 0.5 - header.center[axis] * this.scale[axis]);
    this.defines = `#define BANDS ${this.bands}\n${header.texture ? "#define TEXTURED\n" : ""}${header.ground ? "#define GROUNDED\n" : ""}`;
    this.painted = Boolean(header.ground); // whether the painted ground is shown
  }

  /** Nothing is on the device, or no longer. */
  forget() {
    this.programs = {};
    this.textures = [];
    this.targets = {};
    this.bytes = []; // of the textures, as the device holds them
    this.slots = [null, null]; // number of the color set in each of the two textures
    this.filled = (this.filled ?? 0) + 1; // how often what they hold has changed
  }

  /** Read what all color sets share, and upload it. */
  async load() {
    const { gl, header } = this;
    this.lattice = new Lattice(header, await stream("mask"));
    this.bricks = new Bricks(this.lattice, gl.getParameter(gl.MAX_3D_TEXTURE_SIZE), this.bands);
    const [across, down, deep] = this.bricks.shape;
    this.upload(0, "RGBA8UI", [across, down, deep], "RGBA_INTEGER", "UNSIGNED_BYTE",
      this.bricks.table(), "NEAREST");
    const codes = this.lattice.restore(await stream("density"), 1);
    const value = Uint16Array.from({ length: 256 }, (_, code) => {
      const root = (code - header.zero) / (255 - header.zero);
      return half(root * Math.abs(root) * header.top);
    });
    const [wide, high, long] = this.bricks.atlas;
    const density = new Uint16Array(wide * high * long);
    this.bricks.fill((texel, row) => { density[texel] = row < 0 ? 0 : value[codes[row]]; });
    this.upload(1, "R16F", this.bricks.atlas, "RED", "HALF_FLOAT", density, "LINEAR");
    if (header.texture) await this.loadTexture();
    if (header.ground) await this.loadGround();
  }

  /** Read the painted ground's picture, and upload it. */
  async loadGround() {
    const { gl } = this;
    const picture = new Image();
    picture.src = this.header.ground.picture;
    await picture.decode();
    gl.activeTexture(gl.TEXTURE0 + GROUND);
    this.textures[GROUND] = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.textures[GROUND]);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const name of ["WRAP_S", "WRAP_T"]) {
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl.MIRRORED_REPEAT);
    }
    this.bytes[GROUND] = Math.round(4 / 3 * 4 * picture.width * picture.height);
    this.groundPixels = picture.width / this.header.ground.width;
  }

  /**
   * What a program needs to draw the ground.
   * @param {object} how `frame` [9], `depth`, `level`: see ground.glsl.
   */
  ground(at, { frame = [1, 0, 0, 0, 1, 0, 0, 0, 1], depth, level = -1 }) {
    const { gl } = this;
    const { ground, sets } = this.header;
    gl.uniform1i(at("groundPicture"), GROUND);
    gl.uniform4f(at("groundPlace"), ground.left, ground.top, ground.width, ground.height);
    gl.uniform1f(at("groundDepth"), depth);
    gl.uniform1f(at("groundLevel"), level);
    gl.uniformMatrix3fv(at("groundTurn"), false, frame);
    // It belongs to the painting: the photo has the page's plain ground.
    gl.uniform1f(at("groundShare"), this.painted ? (sets.length > 1 ? this.blend : 1) : 0);
  }

  /** Read what the textures of all color sets share, and upload it. */
  async loadTexture() {
    const { gl, bricks, header } = this;
    const texture = new Texture(header, await stream("texels"));
    const cells = texture.cells(bricks, await stream("charts"));
    this.upload(CELLS, "R8UI", bricks.places.map((n) => n * BRICK), "RED_INTEGER", "UNSIGNED_BYTE",
      cells, "NEAREST");
    const maps = texture.maps(this.scale, this.shift);
    this.flat(CHARTS, "RGBA32F", "FLOAT", [{ texels: maps, width: 3, height: maps.length / 12 }], "NEAREST");
    this.finest = texture.finest(gl.getParameter(gl.MAX_TEXTURE_SIZE));
    this.texture = texture;
  }

  /**
   * Show a mix of two color sets.
   * @param {number} from Number of a set.
   * @param {number} to Number of another, or the same.
   * @param {number} blend Share of the latter, 0 to 1.
   * @param {boolean} all Read both, even where one of them is not seen.
   */
  async show(from, to, blend, all = false) {
    if (this.slots[0] !== from && (all || blend < 1)) await this.colors(0, from);
    if (this.slots[1] !== to && (all || blend > 0)) await this.colors(1, to);
    this.blend = blend;
  }

  /** Read a color set and put it into one of the two textures. */
  async colors(slot, number) {
    const { bricks, lattice, bands, gl } = this;
    const [wide, high, long] = bricks.atlas;
    const size = wide * high * long;
    const texels = new Uint8Array(4 * size * bands);
    for (let band = 0; band < bands; band++) {
      const values = lattice.restore(await stream(`set${number}.${band}`), 3);
      const { low, high: top } = this.header.sets[number].bands[band];
      // Where there is nothing the renderer has coefficients of 0: grey in the first band.
      const nothing = Math.round(((band ? 0 : 0.5) - low) / (top - low) * 255);
      bricks.fill((texel, row) => {
        const at = 4 * (texel + band * size);
        texels[at] = row < 0 ? nothing : values[3 * row + 1];
        texels[at + 1] = row < 0 ? nothing : values[3 * row];
        texels[at + 2] = row < 0 ? nothing : values[3 * row + 2];
      });
    }
    this.upload(2 + slot, "RGBA8", [wide, high, long * bands], "RGBA", "UNSIGNED_BYTE", texels,
      "LINEAR");
    if (this.header.texture?.sets[number]) {
      const levels = this.texture.pyramid(await stream(`texels${number}`));
      this.flat(TEXELS + slot, "RGBA8", "UNSIGNED_BYTE", levels.slice(this.finest), "LINEAR");
    } else if (this.textures[TEXELS + slot]) {
      gl.deleteTexture(this.textures[TEXELS + slot]);
      this.textures[TEXELS + slot] = null;
      this.bytes[TEXELS + slot] = 0;
    }
    this.slots[slot] = number;
    this.filled++;
    gl.flush();
  }

  /** A plain texture with its levels, finest first. */
  flat(unit, kind, type, levels, filter) {
    const { gl } = this;
    const [{ width, height }] = levels;
    gl.activeTexture(gl.TEXTURE0 + unit);
    if (this.textures[unit]) gl.deleteTexture(this.textures[unit]);
    this.textures[unit] = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texStorage2D(gl.TEXTURE_2D, levels.length, gl[kind], width, height);
    this.bytes[unit] = 0;
    levels.forEach(({ texels, width: wide, height: high }, level) => {
      gl.texSubImage2D(gl.TEXTURE_2D, level, 0, 0, wide, high, gl.RGBA, gl[type], texels);
      this.bytes[unit] += texels.byteLength;
    });
    for (const name of ["WRAP_S", "WRAP_T"]) {
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl.CLAMP_TO_EDGE);
    }
    const between = levels.length > 1 ? "_MIPMAP_NEAREST" : "";
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl[filter + between]);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl[filter]);
  }

  upload(unit, kind, [width, height, depth], format, type, data, filter) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    if (this.textures[unit]) gl.deleteTexture(this.textures[unit]);
    this.textures[unit] = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_3D, this.textures[unit]);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl[kind], width, height, depth);
    this.bytes[unit] = data.byteLength;
    gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, 0, width, height, depth, gl[format], gl[type], data);
    for (const name of ["WRAP_S", "WRAP_T", "WRAP_R"]) {
      gl.texParameteri(gl.TEXTURE_3D, gl[`TEXTURE_${name}`], gl.CLAMP_TO_EDGE);
    }
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MIN_FILTER, gl[filter]);
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MAG_FILTER, gl[filter]);
  }

  /** A program by the name of its shader; `defines` are further lines at its head. */
  program(name, defines = "") {
    const key = name + defines;
    if (this.programs[key]) return this.programs[key];
    const { gl } = this;
    const head = `#version 300 es\n${this.defines}${defines}`;
    const program = gl.createProgram();
    const sources = [[gl.VERTEX_SHADER, CORNERS],
      [gl.FRAGMENT_SHADER, `${head}\n${SHADERS.march}\n${SHADERS.texture}\n${SHADERS.ground}\n${SHADERS[name]}`]];
    for (const [kind, source] of sources) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
        throw new Error(gl.getShaderInfoLog(shader));
      }
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getProgramInfoLog(program));
    }
    const places = {};
    const at = (uniform) => {
      if (!(uniform in places)) places[uniform] = gl.getUniformLocation(program, uniform);
      return places[uniform];
    };
    this.programs[key] = { program, at };
    return this.programs[key];
  }

  /**
   * Use a program with what all of them take.
   * @param {number} footprint Width of the detail that is wanted, in world units.
   */
  begin(name, step, footprint, defines) {
    const { gl } = this;
    const { program, at } = this.program(name, defines);
    gl.useProgram(program);
    ["bricks", "matter", "first", "second"].forEach((sampler, unit) => {
      gl.uniform1i(at(sampler), unit);
    });
    const tones = (set) => this.header.sets[set ?? 0].bands.flatMap(({ low, high }) => [low, high - low]);
    gl.uniform2fv(at("firstTone"), tones(this.slots[0]));
    gl.uniform2fv(at("secondTone"), tones(this.slots[1]));
    gl.uniform1f(at("blend"), this.blend);
    gl.uniform3iv(at("points"), this.points);
    gl.uniform3fv(at("texel"), this.bricks.atlas.map((n) => 1 / n));
    gl.uniform1f(at("stepSize"), step);
    gl.uniform1f(at("stop"), 1e-3);
    if (this.texture) {
      const samplers = { cells: CELLS, charts: CHARTS, firstTexels: TEXELS, secondTexels: TEXELS + 1 };
      for (const [sampler, unit] of Object.entries(samplers)) gl.uniform1i(at(sampler), unit);
      const has = this.slots.map((set) => Number(set !== null && this.header.texture.sets[set]));
      gl.uniform2iv(at("textured"), has);
      gl.uniform1i(at("finest"), this.finest);
      gl.uniform1f(at("level"), Math.max(this.texture.level(footprint, name === "panel"), this.finest));
    }
    return at;
  }

  /**
   * Draw a pinhole view, or some rows of it, into the framebuffer that is bound.
   * @param {object} camera `turn` [9] by columns, `eye` [3], `lens` [4]; see view.glsl.
   * @param {number[]} size Width and height in pixels.
   * @param {object} how `step` in voxels, `jitter` [2], `nudge` [2], `rows` [first, count], `count`.
   */
  view(camera, size, { step = 0.5, jitter = [0, 0], nudge = [0, 0], rows, count = false } = {}) {
    const { gl } = this;
    const away = Math.hypot(...camera.eye.map((value, axis) => value - this.header.center[axis]));
    const footprint = 2 * DETAIL * away / (camera.lens[0] + camera.lens[1]);
    const at = this.begin("view", step, footprint, count ? "#define COUNT" : "");
    gl.uniformMatrix3fv(at("turn"), false, camera.turn);
    gl.uniform3fv(at("eye"), camera.eye);
    gl.uniform4fv(at("lens"), camera.lens);
    gl.uniform2fv(at("size"), size);
    gl.uniform3fv(at("scale"), this.scale);
    gl.uniform3fv(at("shift"), this.shift);
    gl.uniform2fv(at("nudge"), nudge);
    gl.uniform2fv(at("jitter"), jitter);
    const { ground, start } = this.header;
    if (ground) {
      const away = camera.eye.map((value, axis) => value - start.target[axis]);
      this.ground(at, { frame: groundFrame(away), depth: ground.depth });
    }
    this.draw(size, rows);
  }

  draw([width, height], rows) {
    const { gl } = this;
    gl.viewport(0, 0, width, height);
    gl.disable(gl.BLEND);
    if (rows) {
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, rows[0], width, rows[1]);
    }
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** A picture of `size` to draw into, kept by its name. */
  target(name, [width, height]) {
    const { gl } = this;
    const old = this.targets[name];
    if (old && old.width === width && old.height === height) return old.frame;
    this.release(name);
    const texture = gl.createTexture(), frame = gl.createFramebuffer();
    gl.activeTexture(gl.TEXTURE0 + 6);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    this.targets[name] = { texture, frame, width, height };
    return frame;
  }

  /** Give a picture's memory back, if it is there. */
  release(name) {
    const { gl, targets } = this;
    if (!targets[name]) return;
    gl.deleteTexture(targets[name].texture);
    gl.deleteFramebuffer(targets[name].frame);
    delete targets[name];
  }

  /** Put a picture onto the canvas, stretched to it. */
  present(frame, [width, height]) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const same = width === canvas.width && height === canvas.height;
    gl.blitFramebuffer(0, 0, width, height, 0, 0, canvas.width, canvas.height,
      gl.COLOR_BUFFER_BIT, same ? gl.NEAREST : gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Pixels of the framebuffer that is bound, from the bottom row up. */
  pixels([width, height]) {
    const bytes = new Uint8Array(4 * width * height);
    this.gl.readPixels(0, 0, width, height, this.gl.RGBA, this.gl.UNSIGNED_BYTE, bytes);
    return bytes;
  }
}
