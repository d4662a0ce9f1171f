// The portrait's data: base64 in the page -> lattice rows.
//
// A stream is deflated. Densities and colors are stored as what their neighbours do not tell:
// a value is guessed as the mean of those at x - 1, y - 1 and z - 1 (share/page/kernels/residuals).

/** A sentence for the person who looks at the page. */
class UserError extends Error {}

/** Bytes of a stream of the page. */
async function stream(name) {
  const element = document.querySelector(`script[data-stream="${name}"]`);
  if (!element) throw new UserError("This file is incomplete: a part of it is missing. Get it once more.");
  const text = atob(element.textContent);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = text.charCodeAt(i);
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(inflated).arrayBuffer());
}

/** The lattice of a portrait: which points are kept, and their values when they are asked for. */
class Lattice {
  /**
   * @param {object} header Of the page.
   * @param {Uint8Array} mask One bit a lattice point, x fastest, the highest bit first.
   */
  constructor(header, mask) {
    [this.depth, this.height, this.width] = header.shape;
    this.rows = header.rows;
    this.mask = mask;
    if (mask.length < this.depth * this.height * this.width / 8) throw new Error("mask too short");
  }

  /**
   * Number the rows of a plane z into `out`, int32 [height * width], -1 where there is none.
   * @returns {number} The number after the plane's last.
   */
  number(z, next, out) {
    const size = this.height * this.width, start = z * size;
    out.fill(-1, 0, size);
    // Most bytes of a mask are 0: nothing is there.
    for (let byte = start >> 3; 8 * byte < start + size; byte++) {
      const bits = this.mask[byte];
      if (!bits) continue;
      for (let i = 8 * byte - start, bit = 128; bit; i++, bit >>= 1) {
        if (bits & bit && i >= 0 && i < size) out[i] = next++;
      }
    }
    return next;
  }

  /**
   * Rows' values from what the guesses lack.
   * @param {Uint8Array} lacks `channels` planes of a byte a row.
   * @returns {Uint8Array} [rows, channels]
   */
  restore(lacks, channels) {
    if (lacks.length !== channels * this.rows) throw new Error("stream of the wrong length");
    const { width, height, rows } = this;
    const values = new Uint8Array(channels * rows);
    let here = new Int32Array(width * height), before = new Int32Array(width * height).fill(-1);
    let next = 0;
    for (let z = 0; z < this.depth; z++) {
      next = this.number(z, next, here);
      for (let y = 0, i = 0; y < height; y++) {
        for (let x = 0; x < width; x++, i++) {
          const row = here[i];
          if (row < 0) continue;
          const left = x > 0 ? here[i - 1] : -1;
          const above = y > 0 ? here[i - width] : -1;
          const deep = before[i];
          let correction = 0;
          for (let channel = 0; channel < channels; channel++) {
            let total = 0, count = 0;
            if (left >= 0) { total += values[left * channels + channel]; count++; }
            if (above >= 0) { total += values[above * channels + channel]; count++; }
            if (deep >= 0) { total += values[deep * channels + channel]; count++; }
            let guess = count ? Math.floor((2 * total + count) / (2 * count)) : 128;
            guess = Math.min(Math.max(guess + correction, 0), 255);
            const value = (guess + lacks[channel * rows + row]) & 255;
            values[row * channels + channel] = value;
            if (channel === 0) correction = value - guess;
          }
        }
      }
      [here, before] = [before, here];
    }
    return values;
  }
}
