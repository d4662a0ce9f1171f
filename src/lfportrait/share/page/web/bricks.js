// Lattice rows -> the textures that rays are cast through (field/kernels/bricks.py).

const BRICK = 4; // cells along a brick's edge
const SIDE = BRICK + 1; // lattice points along it: one shared layer

/** Where the bricks of a lattice are, and where each has its place in the atlas. */
class Bricks {
  /**
   * @param {Lattice} lattice
   * @param {number} longest Longest side of a 3D texture on this device.
   * @param {number} bands Atlases of colors that lie behind one another in one texture.
   */
  constructor(lattice, longest, bands) {
    this.lattice = lattice;
    this.shape = [lattice.width, lattice.height, lattice.depth]
      .map((n) => Math.max(1, Math.ceil((n - 1) / BRICK)));
    this.occupied = this.findOccupied();
    this.count = this.occupied.length;
    // As near to a cube as whole bricks allow: nothing is wasted, no side is long.
    const most = Math.min(255, Math.floor(Math.min(longest, 2048) / SIDE));
    const deepest = Math.min(255, Math.floor(Math.min(longest, 2048) / SIDE / bands));
    const cube = Math.ceil(Math.cbrt(this.count));
    const wide = Math.min(most, Math.max(1, cube, Math.ceil(Math.sqrt(this.count / deepest))));
    const deep = Math.max(1, Math.ceil(this.count / (wide * wide)));
    if (deep > deepest) {
      throw new UserError("This portrait is too large for this device's graphics. Export it with a smaller --max-size.");
    }
    this.places = [wide, wide, deep];
    this.atlas = this.places.map((n) => n * SIDE);
  }

  /** Numbers of the bricks in which a lattice point is kept, x fastest. */
  findOccupied() {
    const { width, height, depth } = this.lattice;
    const [across, down, deep] = this.shape;
    const found = new Uint8Array(across * down * deep);
    const plane = new Int32Array(width * height);
    for (let z = 0; z < depth; z++) {
      this.lattice.number(z, 0, plane);
      for (let y = 0, i = 0; y < height; y++) {
        for (let x = 0; x < width; x++, i++) {
          if (plane[i] < 0) continue;
          // A point on the border belongs to the bricks of both sides.
          for (let bz = Math.max(0, (z - 1) >> 2); bz <= z >> 2; bz++) {
            for (let by = Math.max(0, (y - 1) >> 2); by <= y >> 2; by++) {
              for (let bx = Math.max(0, (x - 1) >> 2); bx <= x >> 2; bx++) {
                if (bx < across && by < down && bz < deep) found[(bz * down + by) * across + bx] = 1;
              }
            }
          }
        }
      }
    }
    const numbers = [];
    for (let i = 0; i < found.length; i++) if (found[i]) numbers.push(i);
    return Int32Array.from(numbers);
  }

  /**
   * An entry for each brick: its place in the atlas, and its distance to the nearest occupied one.
   * @returns {Uint8Array} [bricks, 4]
   */
  table() {
    const [across, down, deep] = this.shape;
    const distance = new Uint8Array(across * down * deep).fill(255);
    for (const number of this.occupied) distance[number] = 0;
    // Chessboard distance by two sweeps: every way to a brick leads through neighbours.
    const sweep = (backwards) => {
      const sign = backwards ? 1 : -1;
      for (let step = 0; step < distance.length; step++) {
        const i = backwards ? distance.length - 1 - step : step;
        const x = i % across, y = Math.floor(i / across) % down, z = Math.floor(i / (across * down));
        let least = distance[i];
        for (let n = 0; n < 13 && least > 0; n++) {
          // The 13 neighbours that the sweep has passed: half of the 26.
          const dx = n % 3 - 1, dy = Math.floor(n / 3) % 3 - 1, dz = Math.floor(n / 9) - 1;
          const u = x - sign * dx, v = y - sign * dy, w = z - sign * dz;
          if (u < 0 || v < 0 || w < 0 || u >= across || v >= down || w >= deep) continue;
          least = Math.min(least, distance[(w * down + v) * across + u] + 1);
        }
        distance[i] = Math.min(least, 254);
      }
    };
    sweep(false);
    sweep(true);
    const entries = new Uint8Array(4 * distance.length);
    for (let i = 0; i < distance.length; i++) entries[4 * i + 3] = distance[i];
    this.occupied.forEach((brick, number) => {
      const [x, y, z] = this.place(number);
      entries.set([x, y, z, 0], 4 * brick);
    });
    return entries;
  }

  /** Place in the atlas of an occupied brick by its number, in bricks. */
  place(number) {
    const [wide, high] = this.places;
    return [number % wide, Math.floor(number / wide) % high, Math.floor(number / (wide * high))];
  }

  /**
   * Fill an atlas: `write(texel, row)` for every texel of an occupied brick; row -1 is empty.
   */
  fill(write) {
    const { width, height, depth } = this.lattice;
    const [across, down] = this.shape;
    const [wide, high] = this.atlas;
    // Five planes of row numbers at a time are all that a layer of bricks needs.
    const planes = Array.from({ length: SIDE }, () => new Int32Array(width * height));
    let numbered = 0, next = 0;
    this.occupied.forEach((brick, number) => {
      const bx = brick % across, by = Math.floor(brick / across) % down;
      const bz = Math.floor(brick / (across * down));
      for (; numbered < Math.min(depth, BRICK * bz + SIDE); numbered++) {
        next = this.lattice.number(numbered, next, planes[numbered % SIDE]);
      }
      const [px, py, pz] = this.place(number);
      for (let z = 0; z < SIDE; z++) {
        const gz = BRICK * bz + z;
        for (let y = 0; y < SIDE; y++) {
          const gy = BRICK * by + y;
          let texel = ((pz * SIDE + z) * high + py * SIDE + y) * wide + px * SIDE;
          for (let x = 0; x < SIDE; x++, texel++) {
            const gx = BRICK * bx + x;
            const inside = gx < width && gy < height && gz < depth;
            write(texel, inside ? planes[gz % SIDE][gy * width + gx] : -1);
          }
        }
      }
    });
  }
}
