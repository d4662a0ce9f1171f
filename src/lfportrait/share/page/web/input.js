// Hands: pointer, wheel, pinch, keys, and the tilt of a telephone.

class Input {
  constructor(canvas, viewer) {
    this.canvas = canvas;
    this.viewer = viewer;
    this.pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.dragged(event));
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.front());
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.tilt();
  }

  front() {
    const { viewer } = this;
    viewer.orbit.front();
    viewer.clock = 0;
    if (viewer.panel) viewer.panel.place.turn = 0;
    viewer.change();
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    // What the sway has turned the head to is where the hand takes over.
    const { viewer } = this;
    if (!viewer.panel) viewer.orbit.yaw += viewer.sway() - viewer.tilt[0];
    viewer.clock = 0;
    viewer.change();
  }

  middle() {
    const places = [...this.pointers.values()];
    return [0, 1].map((axis) => places.reduce((sum, p) => sum + p[axis], 0) / places.length);
  }

  spread() {
    const [one, other] = [...this.pointers.values()];
    return Math.hypot(one[0] - other[0], one[1] - other[1]);
  }

  /** A place of the window, in pixels from the picture's middle. */
  place([x, y]) {
    const box = this.canvas.getBoundingClientRect();
    return [x - box.left - box.width / 2, y - box.top - box.height / 2];
  }

  dragged(event) {
    const { viewer, canvas } = this;
    if (viewer.panel) {
      // On a panel the head follows the pointer, pressed or not.
      if (Math.abs(event.movementX) + Math.abs(event.movementY) === 0) return;
      const share = this.place([event.clientX, event.clientY])[0] / canvas.clientWidth;
      viewer.panel.place.turn = -share * Math.PI / 3;
      viewer.change();
      return;
    }
    const old = this.pointers.get(event.pointerId);
    if (!old) return;
    const size = [canvas.clientWidth, canvas.clientHeight];
    const two = this.pointers.size === 2;
    const [middle, spread] = two ? [this.middle(), this.spread()] : [];
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const by = [event.clientX - old[0], event.clientY - old[1]];
    if (two) {
      const now = this.middle();
      viewer.orbit.pan(now[0] - middle[0], now[1] - middle[1], size);
      viewer.orbit.closer(this.spread() / Math.max(spread, 1), this.place(now));
    } else if (event.shiftKey || event.buttons & 6) {
      viewer.orbit.pan(by[0], by[1], size);
    } else {
      const speed = Math.PI / Math.min(...size) / Math.sqrt(viewer.orbit.zoom);
      viewer.orbit.turn(-by[0] * speed, by[1] * speed);
    }
    viewer.change();
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 24 : event.deltaMode === 2 ? 400 : 1;
    const factor = Math.exp(-Math.min(Math.max(event.deltaY * lines, -400), 400) * 0.0022);
    this.viewer.orbit.closer(factor, this.place([event.clientX, event.clientY]));
    this.viewer.change();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { viewer, canvas } = this;
    const by = Math.PI / 36;
    const turns = {
      ArrowLeft: [-by, 0], ArrowRight: [by, 0], ArrowUp: [0, by], ArrowDown: [0, -by],
    };
    if (turns[event.key] && event.shiftKey) {
      const [x, y] = turns[event.key].map((value) => -Math.sign(value) * 40);
      viewer.orbit.pan(x, -y, [canvas.clientWidth, canvas.clientHeight]);
    } else if (turns[event.key]) viewer.orbit.turn(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") viewer.orbit.closer(1.15, [0, 0]);
    else if (event.key === "-") viewer.orbit.closer(1 / 1.15, [0, 0]);
    else if (event.key === "Home" || event.key === "0") return this.front();
    else return;
    event.preventDefault();
    viewer.change();
  }

  /** Follow the device's tilt where the browser tells it, from how it is held at first. */
  tilt() {
    const listen = () => addEventListener("deviceorientation", (event) => {
      if (event.gamma === null || this.viewer.calm) return;
      this.rest ??= event.gamma;
      this.rest += 0.01 * (event.gamma - this.rest); // a new way to hold it becomes the usual one
      const turned = Math.min(Math.max(event.gamma - this.rest, -30), 30) * Math.PI / 180;
      if (Math.abs(turned - this.viewer.tilt[0]) < 0.004) return;
      this.viewer.tilt = [turned, 0];
      this.viewer.change();
    });
    const asks = globalThis.DeviceOrientationEvent?.requestPermission;
    if (!globalThis.DeviceOrientationEvent) return;
    if (!asks) return listen();
    // iOS gives it for a tap only: the first one on the picture asks.
    this.canvas.addEventListener("click", async () => {
      try {
        if (await DeviceOrientationEvent.requestPermission() === "granted") listen();
      } catch {
        // Not on this page (a file, or no https): the fingers do.
      }
    }, { once: true });
  }
}
