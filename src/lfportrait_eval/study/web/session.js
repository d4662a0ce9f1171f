// One person's answers, kept after each so that a page that is opened again goes on.

/** The person that the page's address names (?person=12), null for a random one. */
function namedPerson() {
  const given = new URLSearchParams(location.search).get("person");
  if (given === null) return null;
  const number = Number(given);
  if (!/^\d{1,9}$/.test(given)) {
    throw new Error("The address names a person that is no number. Write for example index.html?person=12");
  }
  return { person: String(number), number };
}

function randomPerson() {
  const [number] = crypto.getRandomValues(new Uint32Array(1));
  return { person: `r${number.toString(36).padStart(7, "0")}`, number };
}

class Session {
  constructor(study) {
    this.study = study;
    this.named = namedPerson();
    this.key = `lfportrait-study-${study.study}${this.named ? `-${this.named.person}` : ""}`;
    this.kept = true;
    this.read() || this.begin();
  }

  /** Somebody new. */
  begin() {
    this.state = { ...(this.named ?? randomPerson()), started: false, saved: false, place: 0, answers: [] };
    this.plan();
  }

  plan() {
    this.trials = trialsOf(this.study, this.state.number);
    this.steps = this.trials.length * this.study.questions.length;
  }

  /** Take up what was kept; false if there is nothing, or nothing sound. */
  read() {
    try {
      const state = JSON.parse(localStorage.getItem(this.key));
      const sound = state && typeof state.person === "string" && Number.isInteger(state.number)
        && Array.isArray(state.answers) && state.place >= 0 && state.place <= state.answers.length;
      if (!sound) return false;
      this.state = state;
      this.plan();
      return state.answers.length <= this.steps;
    } catch {
      return false;
    }
  }

  keep() {
    try {
      localStorage.setItem(this.key, JSON.stringify(this.state));
    } catch {
      this.kept = false;
    }
  }

  start() {
    this.state.started = true;
    this.keep();
  }

  get finished() {
    return this.state.started && this.state.place >= this.steps;
  }

  /** The trial and the question that are next. */
  get current() {
    const count = this.study.questions.length;
    const trial = Math.floor(this.state.place / count);
    return { trial, shown: this.trials[trial], question: this.study.questions[this.state.place % count] };
  }

  answer(side, seconds) {
    this.state.answers[this.state.place] = [side, Math.round(10 * seconds) / 10];
    this.state.place += 1;
    this.keep();
  }

  back() {
    this.state.place = Math.max(0, this.state.place - 1);
    this.state.saved = false;
    this.keep();
  }

  saved() {
    this.state.saved = true;
    this.keep();
  }

  /** The next person at the same screen. */
  another() {
    this.begin();
    this.keep();
  }

  get fileName() {
    return `answers-${this.study.study}-${this.state.person}.json`;
  }

  /** What is handed over. */
  file() {
    const { study, state } = this, names = study.questions.map(({ name }) => name);
    const trials = this.trials.map((shown, trial) => {
      const { left, right } = sidesOf(study, shown);
      const given = names.map((_, question) => state.answers[trial * names.length + question]);
      return {
        pair: shown.pair, sitter: left.sitter, style: left.style, left: left.method, right: right.method,
        repeat: shown.repeat,
        choices: Object.fromEntries(names.map((name, index) => [name, given[index][0]])),
        seconds: Object.fromEntries(names.map((name, index) => [name, given[index][1]])),
      };
    });
    const data = {
      format: "lfportrait study answers", study: study.study, title: study.title, person: state.person,
      sheet: state.number % study.sheets.length, questions: study.questions, trials,
    };
    return `${JSON.stringify(data, null, 1)}\n`;
  }
}
