// Two videos that turn together.

const APART = 0.07; // seconds; two frames

/** The page's own files: base64 texts in it, as addresses that elements can show. */
class Streams {
  constructor() {
    this.addresses = new Map();
  }

  address(name, kind) {
    if (!name) return "";
    if (!this.addresses.has(name)) {
      const text = document.querySelector(`script[data-stream="${name}"]`).textContent;
      const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
      this.addresses.set(name, URL.createObjectURL(new Blob([bytes], { type: kind })));
    }
    return this.addresses.get(name);
  }
}

function playable(video, address) {
  return new Promise((resolve, reject) => {
    const failed = () => reject(new Error("A video can't be played in this browser. Try another one, or update it."));
    video.addEventListener("canplay", resolve, { once: true });
    video.addEventListener("error", failed, { once: true });
    video.src = address;
    video.load();
  });
}

class Player {
  constructor(left, right, streams) {
    this.videos = [left, right];
    this.streams = streams;
    this.shown = "";
    this.paused = false;
    this.turned = 0;
    const follow = () => {
      this.follow();
      requestAnimationFrame(follow);
    };
    requestAnimationFrame(follow);
  }

  /** Show two portraits; done when both play. False if others were asked for meanwhile. */
  async show(left, right) {
    const wanted = [left, right].map((entry) =>
      entry.file || this.streams.address(entry.video, `video/${entry.kind}`));
    const name = wanted.join(" ");
    if (name === this.shown) return true;
    this.shown = name;
    await Promise.all(this.videos.map((video, side) => playable(video, wanted[side])));
    if (name !== this.shown) return false;
    await this.play();
    return name === this.shown;
  }

  async play() {
    if (this.paused) return;
    // A browser that does not let them play by themselves shows the first picture; Pause goes on.
    await Promise.allSettled(this.videos.map((video) => video.play()));
  }

  pause(paused) {
    this.paused = paused;
    if (paused) for (const video of this.videos) video.pause();
    else this.play();
  }

  /** The right one keeps to the left one's time, round the end of the loop. */
  follow() {
    const [left, right] = this.videos, length = right.duration;
    if (left.seeking || right.seeking || !(length > 0) || performance.now() - this.turned < 500) return;
    const wanted = left.currentTime % length;
    let apart = right.currentTime - wanted;
    apart -= length * Math.round(apart / length);
    if (Math.abs(apart) < APART) return;
    right.currentTime = wanted;
    this.turned = performance.now();
  }
}
