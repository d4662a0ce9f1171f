// What stands on the screen: welcome, pair after pair, thanks.

const QUIET = 280; // milliseconds after an answer in which nothing counts: a second click, a slip

const find = (name) => document.getElementById(name);

function tell(text) {
  find("message").textContent = text;
  find("message").hidden = !text;
}

/** Seconds that somebody could look: time in which the page was hidden does not count. */
class Clock {
  constructor() {
    this.start();
    document.addEventListener("visibilitychange", () => this.turn());
  }

  start() {
    this.spent = 0;
    this.since = document.hidden ? null : performance.now();
  }

  turn() {
    if (this.since !== null) this.spent += performance.now() - this.since;
    this.since = document.hidden ? null : performance.now();
  }

  get seconds() {
    return (this.spent + (this.since === null ? 0 : performance.now() - this.since)) / 1000;
  }
}

class Screens {
  constructor(session) {
    this.session = session;
    this.streams = new Streams();
    this.player = new Player(...document.querySelectorAll("video"), this.streams);
    this.clock = new Clock();
    this.ready = false;
    this.listen();
    this.render();
  }

  listen() {
    const { session } = this;
    find("consent").addEventListener("change", () => {
      find("start").disabled = !find("consent").checked;
    });
    find("start").addEventListener("click", () => {
      session.start();
      this.render();
      find("question").focus();
    });
    for (const side of document.querySelectorAll(".side")) {
      side.querySelector("button").addEventListener("click", (event) => {
        // The second click of a double one, on whatever has come under the pointer by then.
        if (event.detail < 2) this.answer(side.dataset.side);
      });
    }
    find("back").addEventListener("click", (event) => {
      if (event.detail < 2) this.back();
    });
    find("change").addEventListener("click", () => this.back());
    find("pause").addEventListener("click", () => this.pause(!this.player.paused));
    find("save").addEventListener("click", () => this.save());
    find("another").addEventListener("click", () => {
      if (!confirm("Start again for another person? Make sure that the file is saved.")) return;
      session.another();
      find("consent").checked = false;
      find("start").disabled = true;
      this.render();
    });
    document.addEventListener("keydown", (event) => this.key(event));
    // The same study in another window: both show the same.
    addEventListener("storage", (event) => {
      if (event.key === session.key && session.read()) this.render();
    });
  }

  key(event) {
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || find("trial").hidden) return;
    const side = { ArrowLeft: "left", 1: "left", ArrowRight: "right", 2: "right" }[event.key];
    if (side) {
      event.preventDefault();
      this.answer(side);
    } else if (event.key === "Backspace") {
      this.back();
    }
  }

  answer(side) {
    if (!this.ready) return;
    this.lock();
    this.session.answer(side, this.clock.seconds);
    document.querySelector(`[data-side="${side}"]`).classList.add("chosen");
    setTimeout(() => this.render(), QUIET);
  }

  back() {
    if (!this.ready && !this.session.finished) return;
    this.lock();
    this.session.back();
    this.render();
  }

  pause(paused) {
    this.player.pause(paused);
    find("pause").setAttribute("aria-pressed", String(paused));
    find("pause").textContent = paused ? "Play" : "Pause";
  }

  lock() {
    this.ready = false;
    document.documentElement.dataset.ready = "no";
  }

  unlock() {
    this.ready = true;
    document.documentElement.dataset.ready = "yes";
  }

  render() {
    const { session } = this, { started } = session.state;
    this.lock();
    for (const side of document.querySelectorAll(".side")) side.classList.remove("chosen");
    find("welcome").hidden = started;
    find("trial").hidden = !started || session.finished;
    find("done").hidden = !session.finished;
    if (!session.kept) tell("This browser keeps nothing: don't close or reload the page before the end.");
    if (!started) this.welcome();
    else if (session.finished) this.thanks();
    else this.trial();
  }

  welcome() {
    const { study, trials, steps } = this.session, several = study.questions.length > 1;
    find("amount").textContent = `You will see ${trials.length} ${trials.length > 1 ? "pairs" : "pair"}${
      several ? `, and answer ${study.questions.length} questions about each: ${steps} answers` : ""}.`;
  }

  async trial() {
    const { session } = this, { study, state } = session, { trial, shown, question } = session.current;
    const { left, right } = sidesOf(study, shown);
    find("progress").max = session.steps;
    find("progress").value = state.place;
    find("count").textContent = `Pair ${trial + 1} of ${session.trials.length}`;
    find("question").textContent = question.text;
    find("back").disabled = state.place === 0;
    find("painting").src = this.streams.address(left.painting, "image/webp");
    find("person").hidden = !left.photo;
    if (left.photo) find("photo").src = this.streams.address(left.photo, "image/webp");
    const { place } = state;
    try {
      if (!await this.player.show(left, right) || place !== state.place) return;
    } catch (error) {
      this.player.shown = "";
      tell(error.message);
      return;
    }
    this.clock.start();
    this.unlock();
  }

  thanks() {
    find("file").textContent = this.session.fileName;
    find("another").hidden = this.session.named !== null;
    find("done-title").focus();
    if (!this.session.state.saved) this.save();
  }

  /** Hand the answers over as a download. */
  save() {
    const address = URL.createObjectURL(new Blob([this.session.file()], { type: "application/json" }));
    const link = document.createElement("a");
    link.href = address;
    link.download = this.session.fileName;
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
    this.session.saved();
  }
}
