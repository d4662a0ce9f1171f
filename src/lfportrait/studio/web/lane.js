// What the server needs time for goes through three lanes: a browser has six connections to a server, and
// what it has at hand (and its events) must not wait behind pictures that are still to be painted.

const LANES = 3;
const waiting = [];
const going = new Set();
const loose = new Map(); // large pictures on their way, and where they will be seen

/** Free what belongs to pictures that nobody sees any more, then let the next ones in. */
function move() {
  for (const each of going) if (each.gone()) each.end();
  while (going.size < LANES && waiting.length) {
    const next = waiting.shift();
    if (next.gone()) next.drop();
    else {
      going.add(next);
      next.begin();
    }
  }
}

/** After a screen was left: give up what was to be seen on it. */
export function sweep() {
  for (const [image, place] of loose) if (!place.isConnected) image.removeAttribute("src");
  loose.clear();
  move();
}

/** Wait for a lane; the function that comes gives it back. */
function lane(gone, drop) {
  return new Promise((done, failed) => {
    const entry = {
      gone,
      drop: () => drop(failed),
      end: () => {
        if (going.delete(entry)) move();
      },
      begin: () => done(entry.end),
    };
    waiting.push(entry);
    move();
  });
}

/**
 * Do something slow once a lane is free.
 * @param {function} act
 * @param {AbortSignal} signal What has been given up takes no lane.
 */
export async function slowly(act, signal = undefined) {
  const give = await lane(
    () => signal?.aborted ?? false,
    (failed) => failed(new DOMException("given up", "AbortError")),
  );
  try {
    return await act();
  } finally {
    give();
  }
}

const sight = new IntersectionObserver(
  (seen) => {
    for (const { target, isIntersecting } of seen) {
      if (!isIntersecting) continue;
      sight.unobserve(target);
      load(target);
    }
  },
  { rootMargin: "300px" },
);

/** Give a picture its address when a lane is free; `place` is where it is seen. */
async function load(image, place = image) {
  const { wanted } = image.dataset;
  let started = false;
  const give = await lane(
    () => {
      const gone = !place.isConnected;
      // A picture that is on its way to nowhere holds a connection.
      if (gone && started) image.removeAttribute("src");
      return gone;
    },
    () => {},
  );
  started = true;
  const there = () => {
    image.classList.remove("coming");
    give();
  };
  image.addEventListener("load", there, { once: true });
  image.addEventListener("error", there, { once: true });
  image.src = wanted;
}

/** A picture that is asked for when it is in sight and a lane is free. */
export function slowPicture(image, path) {
  image.dataset.wanted = path;
  image.classList.add("coming");
  sight.observe(image);
  return image;
}

/** A picture that the server has at hand: asked for when it is nearly in sight. */
export function quickPicture(image, path) {
  const there = () => image.classList.remove("coming");
  image.classList.add("coming");
  for (const name of ["load", "error"]) image.addEventListener(name, there, { once: true });
  image.loading = "lazy";
  image.src = path;
  return image;
}

/** A small picture, and the large one in its place when that is there; `show` is how both are shown. */
export function growingPicture(image, small, large, show = slowPicture) {
  image.addEventListener(
    "load",
    () => {
      const next = new Image();
      next.alt = image.alt;
      next.dataset.wanted = large;
      next.onload = () => {
        loose.delete(next);
        image.replaceWith(next);
      };
      if (show === slowPicture) load(next, image);
      else {
        loose.set(next, image);
        next.src = large;
      }
    },
    { once: true },
  );
  return show(image, small);
}
