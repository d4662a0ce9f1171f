// The texture of the surface: its charts by cells, and the pyramid of its texels.

const NO_CHART = 255;
const OCTAVES = 6; // of the pyramid, as in field/texture.py
const STEPS = 4; // levels in each of them

/** What all color sets' textures share: the charts, which texels are kept, the level to look at. */
class Texture {
  /**
   * @param {object} header Of the page; `texture` tells of the atlas.
   * @param {Uint8Array} mask One bit a texel.
   */
  constructor(header, mask) {
    this.header = header.texture;
    // A row of the atlas stands for a plane of a lattice: its neighbours are one row's.
    this.kept = new Lattice(this.header, mask);
    this.width = this.kept.width;
    this.height = this.kept.depth;
    this.octaves = 1;
    for (let least = Math.min(this.width, this.height); least >= 4 && this.octaves < OCTAVES; least >>= 1) {
      this.octaves++;
    }
  }

  /** The first octave that a device takes whose textures have at most `longest` texels along a side. */
  finest(longest) {
    let octave = 0;
    while (Math.max(this.width, this.height) >> octave > longest && octave < this.octaves - 1) octave++;
    return octave;
  }

  /** Octaves, in quarters or `whole`, to the detail nearest in width to `footprint`, in world units. */
  level(footprint, whole) {
    const wanted = Math.log2(Math.max(footprint * this.header.pixels, 1e-9));
    const nearest = whole ? Math.round(wanted) : Math.round(wanted * STEPS) / STEPS;
    return Math.min(Math.max(nearest, 0), this.octaves - 1);
  }

  /**
   * From lattice points to texels, three texels of four numbers for each chart.
   * @param {number[]} scale Lattice point = world * scale + shift.
   */
  maps(scale, shift) {
    return Float32Array.from(this.header.projections.flatMap((matrix) => [0, 4, 8].flatMap((row) => {
      const slopes = scale.map((value, axis) => matrix[row + axis] / value);
      return [...slopes, matrix[row + 3] - slopes.reduce((sum, value, axis) => sum + value * shift[axis], 0)];
    })));
  }

  /**
   * The chart that most corners of each cell name.
   * @param {Bricks} bricks
   * @param {Uint8Array} charts Of the lattice's rows.
   * @returns {Uint8Array} An atlas of the bricks' cells.
   */
  cells(bricks, charts) {
    const [wide, high, long] = bricks.atlas;
    const points = new Uint8Array(wide * high * long);
    bricks.fill((texel, row) => { points[texel] = row < 0 ? NO_CHART : charts[row]; });
    const [across, down] = bricks.places.map((n) => n * BRICK);
    const out = new Uint8Array(across * down * bricks.places[2] * BRICK).fill(NO_CHART);
    const corners = [0, 1, wide, wide + 1].flatMap((n) => [n, n + wide * high]).sort((a, b) => a - b);
    for (let number = 0; number < bricks.count; number++) {
      const [px, py, pz] = bricks.place(number);
      for (let cell = 0; cell < BRICK ** 3; cell++) {
        const x = cell & 3, y = cell >> 2 & 3, z = cell >> 4;
        const low = ((pz * SIDE + z) * high + py * SIDE + y) * wide + px * SIDE + x;
        out[((pz * BRICK + z) * down + py * BRICK + y) * across + px * BRICK + x] = this.vote(points, low, corners);
      }
    }
    return out;
  }

  vote(points, low, corners) {
    let found = points[low];
    if (corners.every((corner) => points[low + corner] === found)) return found;
    let most = 0;
    found = NO_CHART;
    for (const corner of corners) {
      const name = points[low + corner];
      const count = corners.reduce((sum, other) => sum + Number(points[low + other] === name), 0);
      if (name !== NO_CHART && count > most) {
        most = count;
        found = name;
      }
    }
    return found;
  }

  /**
   * The pyramid of a color set, finest level first: red, green, blue and nothing of each texel.
   * @param {Uint8Array} lacks The set's stream.
   */
  pyramid(lacks) {
    const { kept, width, height } = this;
    const values = kept.restore(lacks, 3);
    const texels = new Uint8Array(4 * width * height).fill(128);
    const plane = new Int32Array(width);
    for (let y = 0, next = 0; y < height; y++) {
      next = kept.number(y, next, plane);
      for (let x = 0; x < width; x++) {
        const row = plane[x];
        if (row < 0) continue;
        const at = 4 * (y * width + x);
        texels[at] = values[3 * row + 1];
        texels[at + 1] = values[3 * row];
        texels[at + 2] = values[3 * row + 2];
      }
    }
    const octaves = [{ texels, width, height }];
    while (octaves.length < this.octaves) octaves.push(this.halved(octaves[octaves.length - 1]));
    return octaves;
  }

  /** Every second texel, blurred by 1, 3, 3, 1 along both sides; beyond the border there is 128. */
  halved({ texels, width, height }) {
    const wide = width >> 1, high = height >> 1;
    const out = new Uint8Array(4 * wide * high);
    const sums = new Int32Array(4 * (width + 2)).fill(8 * 128);
    for (let y = 0; y < high; y++) {
      // Of the first row the one before it is missing, of the last one maybe the one behind it.
      const row = 8 * y * width, above = y > 0, below = 2 * y + 2 < height;
      for (let x = 0; x < 4 * width; x++) {
        const at = row + x;
        sums[4 + x] = (above ? texels[at - 4 * width] : 128) + 3 * texels[at]
          + 3 * texels[at + 4 * width] + (below ? texels[at + 8 * width] : 128);
      }
      for (let x = 0; x < wide; x++) {
        for (let channel = 0; channel < 3; channel++) {
          const at = 8 * x + channel;
          out[4 * (y * wide + x) + channel] = sums[at] + 3 * sums[at + 4] + 3 * sums[at + 8]
            + sums[at + 12] + 32 >> 6;
        }
      }
    }
    return { texels: out, width: wide, height: high };
  }
}
