// Panels: our TOML files and Looking Glass's visual.json, as lightfield/display.py reads them.

const PATTERNS = ["single", "checkerboard", "rows", "staggered", "columns"];
const DEFAULTS = {
  slant: 0, offset: 0, subpixels: "RGB", cone: 40, distance: 4, eye_height: 0, inverted: false,
  flip_x: false, flip_y: false, cells: [], cell_pattern: "single", gamma: 2.2, name: "display",
};

/** A display file's text -> entries; what is not ours is refused, as on the command line. */
function readToml(text) {
  const entries = {};
  // An array may go over several lines: lines are joined until its brackets close.
  let open = "";
  for (const line of text.split(/\r?\n/)) {
    open += `${withoutComment(line)} `;
    const outside = open.replace(/"(?:[^"\\]|\\.)*"/g, "");
    if (count(outside, "[") > count(outside, "]")) continue;
    const statement = open.trim();
    open = "";
    if (!statement) continue;
    const parts = /^([A-Za-z0-9_-]+)\s*=\s*(.+)$/.exec(statement);
    if (!parts) throw new UserError(`This display file has a line that cannot be read: ${statement}`);
    entries[parts[1]] = tomlValue(parts[1], parts[2].trim());
  }
  if (open.trim()) throw new UserError("This display file ends within a list.");
  if ("slant_degrees" in entries) {
    entries.slant = entries.slant_degrees * Math.PI / 180;
    delete entries.slant_degrees;
  }
  return entries;
}

function count(text, letter) {
  return text.split(letter).length - 1;
}

function withoutComment(line) {
  const quoted = /^((?:[^"'#]|"(?:[^"\\]|\\.)*"|'[^']*')*)/.exec(line);
  return quoted[1];
}

function tomlValue(key, text) {
  const plain = /^'([^']*)'$/.exec(text);
  if (plain) return plain[1];
  // Numbers may have a sign, underscores and a bare end; JSON knows none of these.
  const json = text.replace(/"(?:[^"\\]|\\.)*"|[^"]+/g, (part) => part.startsWith('"') ? part
    : part.replace(/(\d)_(?=\d)/g, "$1").replace(/\+(?=\d)/g, "").replace(/,\s*\]/g, "]"));
  try {
    return JSON.parse(json);
  } catch {
    throw new UserError(`This display file's ${key} cannot be read: ${text}`);
  }
}

/** Looking Glass's visual.json -> entries (lightfield/display_files.py). */
function readCalibration(text) {
  let data;
  try {
    data = JSON.parse(text);
  } catch {
    throw new UserError("This calibration is not valid JSON.");
  }
  data = data?.calibration ?? data;
  const plain = (key) => data?.[key]?.value ?? data?.[key];
  const number = (key, otherwise) => {
    const entry = plain(key) ?? otherwise;
    const value = Number(entry);
    if (entry === undefined || entry === "" || !Number.isFinite(value)) {
      throw new UserError(`This calibration's ${key} is not a number.`);
    }
    return value;
  };
  const width = Math.round(number("screenW")), height = Math.round(number("screenH"));
  const slope = number("slope"), dpi = number("DPI"), lenses = number("pitch");
  if (!slope || dpi <= 0 || width < 1 || height < 1 || !lenses) {
    throw new UserError("This calibration's pitch, slope, DPI, screenW and screenH must not be 0.");
  }
  const flipX = number("flipImageX", 0) >= 0.5, flipY = number("flipImageY", 0) >= 0.5;
  const lens = lenses * (width / dpi) * Math.cos(Math.atan(1 / slope));
  const tilt = height / (width * slope) * (flipX ? -1 : 1);
  const pitch = 3 * width / lens;
  const top = flipY ? 0.5 / height : 1 - 0.5 / height, down = (flipY ? 1 : -1) / height;
  const phase = (0.5 / width + top * tilt) * lens - number("center");
  const names = ["ROffsetX", "ROffsetY", "GOffsetX", "GOffsetY", "BOffsetX", "BOffsetY"];
  const cells = (plain("subpixelCells") ?? []).map((cell) => names.map((name) => Number(cell[name])));
  const mode = cells.length ? Math.round(number("CellPatternMode", 0)) : 0;
  if (!PATTERNS[mode]) throw new UserError(`This calibration's CellPatternMode ${mode} is not known.`);
  const size = Math.abs(pitch), raw = (pitch > 0 ? phase : -phase) * size;
  const quilt = Number(plain("numViews")) || QUILT_VIEWS(String(plain("serial") ?? ""), width);
  return {
    width, height, views: quilt, pitch: size, slant: Math.atan(tilt * down * lens * pitch / 3),
    offset: raw - size * Math.floor(raw / size),
    subpixels: !cells.length && number("flipSubp", 0) >= 0.5 ? "BGR" : "RGB",
    cone: number("viewCone", 40), distance: 4,
    inverted: (number("invView", 0) >= 0.5) !== (pitch < 0), flip_x: flipX, flip_y: flipY, cells,
    cell_pattern: PATTERNS[mode], name: String(plain("serial") ?? "") || "looking-glass",
    calibrated: true,
  };
}

/** Views of a model's customary quilt, which a calibration does not tell. */
function QUILT_VIEWS(serial, width) {
  const start = Object.keys(HEADER.quilts).filter((key) => serial.toUpperCase().startsWith(key))
    .sort((one, other) => other.length - one.length)[0];
  return HEADER.quilts[start ?? String(width)] ?? 45;
}

/** A panel from a file's text or a preset's entries, looked through. */
function makeDisplay(entries) {
  const panel = { ...DEFAULTS, ...entries };
  const need = (good, text) => {
    if (!good) throw new UserError(`The display ${panel.name}: ${text}.`);
  };
  const between = (key, low, high) => {
    const value = panel[key];
    need(typeof value === "number" && value >= low && value <= high,
      `${key} must be a number from ${low} to ${high}`);
  };
  between("width", 1, 16384);
  between("height", 1, 16384);
  between("views", 1, 1024);
  between("pitch", 1, 3 * 65536);
  between("slant", -1.55, 1.55);
  between("cone", 1e-3, 170);
  between("distance", 0.1, 1e4);
  between("eye_height", -1e4, 1e4);
  between("gamma", 0.2, 5);
  need(Number.isFinite(panel.offset), "offset must be a number");
  need(Number.isInteger(panel.width) && Number.isInteger(panel.height)
    && Number.isInteger(panel.views), "width, height and views must be whole numbers");
  need(["RGB", "BGR"].includes(panel.subpixels), "subpixels must be RGB or BGR");
  need(PATTERNS.includes(panel.cell_pattern), `cell_pattern must be one of ${PATTERNS.join(", ")}`);
  need(Array.isArray(panel.cells) && panel.cells.length <= 4 && panel.cells.every((cell) => {
    return Array.isArray(cell) && cell.length === 6
      && cell.every((value) => Number.isFinite(value) && Math.abs(value) <= 2);
  }), "cells must be up to four rows of six numbers between -2 and 2");
  need(!panel.cells.length || (panel.subpixels === "RGB" && !panel.flip_x && !panel.flip_y),
    "cells tell each color's place: subpixels must be RGB and the picture not flipped");
  return panel;
}

/** A display from a dropped file. */
function readDisplay(name, text) {
  const entries = /\.json$/i.test(name) ? readCalibration(text) : readToml(text);
  entries.name ??= name.replace(/\.[^.]*$/, "");
  return makeDisplay(entries);
}

/** Numbers of a panel as panel.glsl takes them: phases of columns and rows, sub-pixels' places. */
function panelNumbers(panel) {
  const { width, height, pitch } = panel;
  const shift = 3 * Math.tan(panel.slant);
  const modulo = (value) => value - pitch * Math.floor(value / pitch);
  const columns = Float32Array.from({ length: width }, (_, x) => modulo(3 * x));
  const rows = Float32Array.from({ length: height }, (_, y) => modulo(y * shift + panel.offset));
  const steps = [], moved = [];
  for (let y = 0; y < 4; y++) {
    for (let x = 0; x < 2; x++) {
      for (let k = 0; k < 3; k++) {
        if (!panel.cells.length) {
          steps.push(k);
          moved.push(0);
          continue;
        }
        // The pattern counts rows from the bottom.
        const up = (((height - 1 - y) % 4) + 4) % 4;
        const number = {
          single: 0, checkerboard: (up + x) % 2, rows: up, staggered: (up + 2 * x) % 4, columns: x,
        }[panel.cell_pattern] % panel.cells.length;
        const [right, high] = panel.cells[number].slice(2 * k, 2 * k + 2);
        steps.push(3 * right - shift * high);
        moved.push(3 * (0.5 + right) - (k + 0.5));
      }
    }
  }
  return { columns, rows, steps, moved, shift };
}
