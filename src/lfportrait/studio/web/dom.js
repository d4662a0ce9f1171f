// Elements from descriptions: no text becomes markup, and the security policy needs no exception.

import { t } from "./i18n.js";
import { ICONS } from "./icons.js";
import { slowPicture } from "./lane.js";

const SVG = "http://www.w3.org/2000/svg";
const HELD = 4; // pixels by which a hand that holds still may move

/**
 * An element.
 * @param {string} what Name and classes: "div.card.wide"; "svg:path" for one of a drawing.
 * @param {object} attributes `onclick` etc. are listeners, `text` is the text, values that are
 *   null or false are left out; those that start with "." are properties; `slow` is the address of a
 *   picture that the server may need time for.
 * @param {...(Node|string|Array|null)} children The attributes may be left out before them.
 */
export function h(what, ...children) {
  const attributes = children[0]?.constructor === Object ? children.shift() : {};
  const [full, ...classes] = what.split(".");
  const drawn = full.startsWith("svg:");
  const element = drawn
    ? document.createElementNS(SVG, full.slice(4))
    : document.createElement(full || "div");
  if (classes.length) element.setAttribute("class", classes.join(" "));
  if (element instanceof HTMLButtonElement) element.type = "button";
  for (const [name, value] of Object.entries(attributes)) set(element, name, value);
  element.append(
    ...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false),
  );
  return element;
}

/** Set one attribute, listener or property. */
export function set(element, name, value) {
  if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
  else if (name === "text") element.textContent = value;
  else if (name === "slow") slowPicture(element, value);
  else if (name.startsWith(".")) element[name.slice(1)] = value;
  else if (name === "class") element.classList.add(...String(value).split(" ").filter(Boolean));
  else if (value === null || value === undefined || value === false) element.removeAttribute(name);
  else element.setAttribute(name, value === true ? "" : String(value));
}

/** A small drawing; beside a text it says nothing of its own. */
export function icon(name) {
  return h(
    "svg:svg.icon",
    { viewBox: "0 0 24 24", "aria-hidden": "true", focusable: "false" },
    ICONS[name].map(([shape, attributes]) => h(`svg:${shape}`, attributes)),
  );
}

/** A button with a drawing, a text, or both. */
export function button(text, onclick, { kind = "", name = null, drawing = null, ...more } = {}) {
  return h(
    `button.button${kind ? `.${kind.split(" ").join(".")}` : ""}`,
    { onclick, "aria-label": name, title: name, ...more },
    drawing && icon(drawing),
    text,
  );
}

/** A button with a drawing alone, whose name is read out. */
export function sign(drawing, name, onclick, kind = "tool") {
  return button("", onclick, { kind, drawing, name });
}

/** A box to tick with a text beside it. */
export function check({ id, checked, small = false, onchange }, ...text) {
  const input = h("input", {
    id,
    type: "checkbox",
    ".checked": Boolean(checked),
    onchange: () => onchange?.(input.checked),
  });
  const whole = h(small ? "label.check.small" : "label.check", { for: id }, input, text);
  whole.input = input;
  return whole;
}

/** The heading of a screen: its title, what is said below it, and what stands beside both. */
export function heading(title, lead, ...beside) {
  return h("header", h("div", h("h1", title), lead), beside);
}

/** Put children in the place of all that is there; the keyboard stays where it was. */
export function fill(element, ...children) {
  const back = held(element);
  element.replaceChildren(
    ...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false),
  );
  back();
  return element;
}

const REACHED = "a[href], button:not(:disabled), input:not([type=hidden]), select, summary, [tabindex='0']";
const reached = (element) => [...element.querySelectorAll(REACHED)].filter((each) => !each.hidden);

const named = (one) => `${one.tagName} ${one.getAttribute("href") ?? ""} ${one.ariaLabel ?? one.textContent}`;

/** Controls that are called as one is, and which of them it is. */
function alike(control) {
  const all = [...document.querySelectorAll(control.tagName)].filter((one) => named(one) === named(control));
  return [all, all.indexOf(control)];
}

/**
 * Let presses of buttons and links count that were drawn again, or moved away under a mouse that held
 * still, between the pointer's coming down and its going up: a browser forgets them. Where others of
 * that name have come or gone it is not known which one was meant.
 */
export function keepPresses() {
  let pressed = null;
  const down = ({ isPrimary, button: number, target, clientX, clientY }) => {
    const control = isPrimary && number === 0 ? target.closest?.("a[href], button, summary") : null;
    pressed = control && { control, before: alike(control), at: [clientX, clientY] };
  };
  const up = ({ type, target, clientX, clientY }) => {
    const { control, before, at } = pressed ?? {};
    pressed = null;
    if (!control || type === "pointercancel" || control.contains(target)) return;
    if (Math.hypot(clientX - at[0], clientY - at[1]) > HELD) return;
    const now = control.isConnected ? control : alike(control)[0][before[1]];
    const many = alike(control)[0].length === before[0].length;
    const modal = document.querySelector("dialog:modal");
    if (now && many && now.checkVisibility() && (!modal || modal.contains(now))) now.click();
  };
  addEventListener("pointerdown", down, true);
  addEventListener("pointerup", up, true);
  addEventListener("pointercancel", up, true);
}

/** Keep what has the focus within an element: the function returned gives it to what stands there then. */
function held(element) {
  const old = document.activeElement;
  if (!old || old === element || !element.contains(old)) return () => {};
  const name = named(old);
  const place = reached(element).indexOf(old);
  return () => {
    if (element.contains(document.activeElement)) return;
    const now = reached(element);
    // The same one, one that is called like it, or one of its kind that has moved up to its place.
    const alike = now.filter((one) => one.className === old.className && one.tagName === old.tagName);
    const near = alike.sort(
      (one, other) => Math.abs(now.indexOf(one) - place) - Math.abs(now.indexOf(other) - place),
    );
    const next = element.contains(old)
      ? old
      : (now.find((one) => named(one) === name) ?? (place >= 0 ? near[0] : null));
    next?.focus({ preventScroll: true });
  };
}

let numbers = 0;
/** An id that no other element has. */
export function fresh(start = "e") {
  return `${start}-${++numbers}`;
}

/** A slider with its value beside it; `note` says what it does. */
export function slider(label, { min, max, step, value, note = "", digits = 2, oninput, onchange }) {
  const shown = (number) => Number(number).toFixed(digits);
  const id = fresh("slider");
  const output = h("output", { for: id, text: shown(value) });
  const input = h("input", {
    type: "range",
    id,
    min,
    max,
    step,
    value,
    "aria-describedby": note ? `${id}-note` : null,
    oninput: () => {
      output.textContent = shown(input.value);
      oninput?.(Number(input.value));
    },
    onchange: () => onchange?.(Number(input.value)),
  });
  const whole = h(
    "div.slider",
    h("label", { for: id, text: label }),
    output,
    input,
    note && h("small", { id: `${id}-note`, text: note }),
  );
  whole.show = (number) => {
    input.value = String(number);
    output.textContent = shown(number);
  };
  whole.input = input;
  return whole;
}

/** Buttons of which one is pressed. */
export function segments(label, choices, chosen, onchange) {
  const whole = h("div.segments", { role: "group", "aria-label": label });
  whole.show = (value) => {
    for (const each of whole.children)
      each.setAttribute("aria-pressed", String(each.dataset.value === String(value)));
  };
  for (const [value, text] of choices) {
    whole.append(
      h("button", {
        "data-value": value,
        text,
        onclick: () => {
          whole.show(value);
          onchange(value);
        },
      }),
    );
  }
  whole.show(chosen);
  return whole;
}

/** Call `act` once, `wait` milliseconds after the last of several calls. */
export function later(act, wait) {
  let timer = 0;
  const call = (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => act(...values), wait);
  };
  call.stop = () => clearTimeout(timer);
  return call;
}

/**
 * Ask in a window over the page.
 * @param {Array[]} buttons Value, text and kind of each; one that leaves is added.
 * @returns {Promise<string>} The value of the button that was pressed; "" for none.
 */
export function ask(title, body, buttons) {
  return new Promise((done) => {
    const id = fresh("dialog");
    const window_ = h(
      "dialog",
      {
        "aria-labelledby": id,
        onclose: () => {
          window_.remove();
          done(window_.returnValue);
        },
      },
      h(
        "form.stack",
        {
          method: "dialog",
          onsubmit: (event) => {
            event.preventDefault();
            window_.close(event.submitter?.value ?? "");
          },
        },
        h("h2", { id, text: title }),
        body,
        h(
          "div.row.end",
          [["", t("cancel")], ...buttons].map(([value, text, kind]) =>
            h(`button.button${kind ? `.${kind}` : ""}`, {
              // Enter presses a form's first button that submits: never the one that leaves.
              ".type": value === "" ? "button" : "submit",
              value,
              text,
              onclick: () => value === "" && window_.close(""),
            }),
          ),
        ),
      ),
    );
    document.body.append(window_);
    window_.showModal();
    // A proposed name gives way to what is typed.
    window_.querySelector("input[autofocus]")?.select();
  });
}
