// Where one looks from: turned about the head, zoomed and moved in the picture's plane.

const TOP = 80 * Math.PI / 180; // highest and lowest one can look from
const LARGEST = 24;
const NARROW = 640; // width of an upright window that has the caption under the portrait
const ROOM = [56, 152]; // pixels above and below the portrait then, as in page.css

class Orbit {
  /** @param {object} start Of the page's header: target, distance, reach, half; limit, if any. */
  constructor(start) {
    this.start = start;
    this.free = false;
    this.front();
  }

  /** Back to the front view. */
  front() {
    this.yaw = 0;
    this.pitch = 0;
    this.zoom = 1;
    this.move = [0, 0]; // of the principal point, in pixels
  }

  /** Radians to each side that a head from one photo is good for, as long as nobody unlocks it. */
  get limit() {
    return this.free ? 0 : this.start.limit ?? 0;
  }

  turn(yaw, pitch) {
    this.yaw = this.bounded(this.yaw + yaw);
    const most = this.limit ? Math.min(this.limit, TOP) : TOP;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -most), most);
  }

  /** A turn to the side as far as it is good. */
  bounded(yaw) {
    return this.limit ? Math.min(Math.max(yaw, -this.limit), this.limit) : yaw;
  }

  /** Zoom so that what lies at a place, in pixels from the middle, stays there. */
  closer(factor, place) {
    const zoom = Math.min(Math.max(this.zoom * factor, 0.5), LARGEST);
    const ratio = zoom / this.zoom;
    this.zoom = zoom;
    this.move = this.move.map((moved, axis) => zoom <= 1 ? 0
      : place[axis] + (moved - place[axis]) * ratio);
  }

  pan(x, y, [width, height]) {
    const most = [width, height].map((n) => n * Math.max(this.zoom - 0.5, 0.5) / 2);
    this.move = [x, y].map((by, axis) => {
      return Math.min(Math.max(this.move[axis] + by, -most[axis]), most[axis]);
    });
  }

  /**
   * The camera for a picture.
   * @param {number[]} size Width and height in pixels.
   * @param {number} ratio Pixels of the picture for one of the window, for moves.
   * @param {number} sway Radians by which idle motion adds to the turn.
   */
  camera([width, height], ratio, sway = 0) {
    const { target, distance, reach, half } = this.start;
    const yaw = this.bounded(this.yaw + sway), pitch = this.pitch;
    const away = [Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), Math.cos(yaw) * Math.cos(pitch)];
    const right = [Math.cos(yaw), 0, -Math.sin(yaw)];
    const forward = away.map((value) => -value);
    const down = [
      forward[1] * right[2] - forward[2] * right[1],
      forward[2] * right[0] - forward[0] * right[2],
      forward[0] * right[1] - forward[1] * right[0],
    ];
    // The nearest point of the head's cylinder is the one that must fit.
    const near = Math.sqrt(distance ** 2 - reach ** 2);
    const narrow = width / ratio <= NARROW && height >= width;
    const [above, below] = ROOM.map((room) => narrow ? Math.min(room * ratio, height / 4) : 0.04 * height);
    const high = height - above - below;
    const focal = 0.5 * near * Math.min(high / half, 0.92 * width / reach) * this.zoom;
    return {
      turn: [...right, ...down, ...forward],
      eye: away.map((value, axis) => target[axis] + distance * value),
      lens: [focal, focal, width / 2 + this.move[0] * ratio, above + high / 2 + this.move[1] * ratio],
    };
  }
}
