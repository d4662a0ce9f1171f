// The 68 landmarks of a face (iBUG order), and what can be done to them; nothing of the screen here.

/** Parts in the picture: "left" is the left of the picture, the sitter's right. */
export const PARTS = {
  jaw: [0, 17],
  "left-brow": [17, 22],
  "right-brow": [22, 27],
  nose: [27, 36],
  "left-eye": [36, 42],
  "right-eye": [42, 48],
  mouth: [48, 68],
};

/** Lines through the points: first, one past the last, whether it closes. */
export const LINES = [
  [0, 17, false],
  [17, 22, false],
  [22, 27, false],
  [27, 31, false],
  [31, 36, false],
  [36, 42, true],
  [42, 48, true],
  [48, 60, true],
  [60, 68, true],
];

/** Number of the point on the other side of the face, for each. */
export const OPPOSITE = [
  16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 26, 25, 24, 23, 22, 21, 20, 19, 18, 17, 27, 28,
  29, 30, 35, 34, 33, 32, 31, 45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40, 54, 53, 52, 51, 50, 49, 48, 59,
  58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65,
];

const NEAR = 0.3; // of the face below the eyes: as far as points count much when others are mirrored
const KEPT = 200; // steps that can be undone

/** Name of the part that a point belongs to. */
export function partOf(number) {
  return Object.keys(PARTS).find((name) => number >= PARTS[name][0] && number < PARTS[name][1]);
}

/** Numbers of the points that move with one: itself, its part, or all. */
export function moving(number, reach) {
  const [first, end] =
    reach === "part" ? PARTS[partOf(number)] : reach === "face" ? [0, 68] : [number, number + 1];
  return Array.from({ length: end - first }, (_, step) => first + step);
}

/** Solution of three linear equations: rows of three factors and what they give, changed in place. */
function solved(rows) {
  for (let k = 0; k < 3; k++) {
    const best = [0, 1, 2].slice(k).reduce((a, b) => (Math.abs(rows[b][k]) > Math.abs(rows[a][k]) ? b : a));
    [rows[k], rows[best]] = [rows[best], rows[k]];
    for (let row = 0; row < 3; row++) {
      if (row === k) continue;
      const factor = rows[row][k] / rows[k][k];
      rows[row] = rows[row].map((value, column) => value - factor * rows[k][column]);
    }
  }
  return rows.map((row, k) => row[3] / row[k]);
}

/**
 * What takes a place on one side of a face to the other side: the affine map that takes pairs of
 * points to each other best, those near by most of all: they lie about as deep. Of a face that looks at
 * us it is the mirror image; of a turned one the far side is narrower, as the other pairs show.
 * @param {number[][]} points The landmarks.
 * @param {number[]} from Points whose opposites are known.
 * @param {number[]} part Points that are to be taken across.
 */
function acrossFace(points, from, part) {
  const middle = [0, 1].map((k) => part.reduce((sum, one) => sum + points[one][k], 0) / part.length);
  const height = Math.hypot(...[0, 1].map((k) => points[8][k] - points[27][k])) || 1;
  const weights = from.map((one) => {
    const away = Math.hypot(points[one][0] - middle[0], points[one][1] - middle[1]) / (NEAR * height);
    return Math.exp(-0.5 * away * away) + 1e-3;
  });
  const sums = [0, 1].map((k) => {
    const rows = [0, 1, 2].map(() => [0, 0, 0, 0]);
    for (const [index, one] of from.entries()) {
      const place = [...points[one], 1];
      const all = [...place, points[OPPOSITE[one]][k]];
      for (const [row, value] of place.entries()) {
        for (const [column, other] of all.entries()) rows[row][column] += weights[index] * value * other;
      }
    }
    return solved(rows);
  });
  return ([x, y]) => sums.map(([a, b, c]) => a * x + b * y + c);
}

/** Points that can be moved, with their past and what was undone. */
export class Landmarks {
  /**
   * @param {number[][]} points 68 pairs of x and y, in pixels of the picture.
   * @param {number[]} size Width and height of the picture: no point leaves it.
   */
  constructor(points, size) {
    this.points = points.map((point) => [...point]);
    this.size = size;
    this.past = [];
    this.future = [];
    this.listeners = [];
    this.open = null; // what belongs to one step of the past: a drag, a run of arrow keys
  }

  /** Call `act` after each change. */
  watch(act) {
    this.listeners.push(act);
  }

  changed() {
    for (const act of this.listeners) act();
  }

  /** Begin a step of the past; steps of the same name, one after another, are one. */
  step(name) {
    if (name && name === this.open) return;
    this.past.push(this.points.map((point) => [...point]));
    if (this.past.length > KEPT) this.past.shift();
    this.future = [];
    this.open = name;
  }

  /** What comes next is a step of its own. */
  close() {
    this.open = null;
  }

  /** Move points by so many pixels; as far as all of them stay in the picture. */
  move(numbers, [x, y]) {
    const by = [x, y].map((wish, k) => {
      const places = numbers.map((number) => this.points[number][k]);
      return Math.min(Math.max(wish, -Math.min(...places)), this.size[k] - 1 - Math.max(...places));
    });
    for (const number of numbers) this.points[number] = this.points[number].map((value, k) => value + by[k]);
    this.changed();
    return by;
  }

  /** The side of the face that a point lies on, onto the other: its part's points, or its pair's. */
  mirror(number) {
    const part = moving(number, "part");
    const inPairs = part.every((one) => part.includes(OPPOSITE[one]));
    // Of a part on both sides the half that the point is in; of a part on one side all of it.
    const half = (one) => Math.sign(OPPOSITE[one] - one) === Math.sign(OPPOSITE[number] - number);
    const from = inPairs ? part.filter((one) => OPPOSITE[one] !== one && half(one)) : part;
    if (OPPOSITE[number] === number || !from.length) return false;
    this.step(null);
    const all = moving(number, "face");
    const known = all.filter((one) => (OPPOSITE[one] === one || half(one)) && !from.includes(one));
    const across = acrossFace(this.points, known, from);
    for (const one of from) {
      const [x, y] = across(this.points[one]);
      this.points[OPPOSITE[one]] = [
        Math.min(Math.max(x, 0), this.size[0] - 1),
        Math.min(Math.max(y, 0), this.size[1] - 1),
      ];
    }
    this.changed();
    return true;
  }

  /** All points at new places, as one step. */
  put(points) {
    this.step(null);
    this.points = points.map((point) => [...point]);
    this.changed();
  }

  undo() {
    return this.turn(this.past, this.future);
  }

  redo() {
    return this.turn(this.future, this.past);
  }

  turn(from, to) {
    if (!from.length) return false;
    to.push(this.points);
    this.points = from.pop();
    this.open = null;
    this.changed();
    return true;
  }
}
