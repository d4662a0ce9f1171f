// What a person sees, in which order: the same whenever the page is opened by the same person.

/** Random numbers in [0, 1) from a seed (mulberry32). */
function randomNumbers(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

/** A copy in random order (Fisher and Yates). */
function shuffled(items, random) {
  const copy = [...items];
  for (let last = copy.length - 1; last > 0; last--) {
    const other = Math.floor(random() * (last + 1));
    [copy[last], copy[other]] = [copy[other], copy[last]];
  }
  return copy;
}

/**
 * The trials of a person: those of their sheet in random order; then some of the first half again,
 * with sides swapped.
 */
function trialsOf(study, number) {
  const random = randomNumbers(number), sheet = study.sheets[number % study.sheets.length];
  const trials = shuffled(sheet, random).map(([pair, swapped]) =>
    ({ pair, swapped: swapped === 1, repeat: false }));
  const enough = Math.max(Math.ceil(trials.length / 2), study.repeats);
  const again = shuffled(trials.slice(0, enough), random).slice(0, study.repeats);
  return [...trials, ...again.map(({ pair, swapped }) => ({ pair, swapped: !swapped, repeat: true }))];
}

/** The portraits of a trial as they stand on the screen. */
function sidesOf(study, { pair, swapped }) {
  const [first, second] = study.pairs[pair].map((entry) => study.entries[entry]);
  return swapped ? { left: second, right: first } : { left: first, right: second };
}
