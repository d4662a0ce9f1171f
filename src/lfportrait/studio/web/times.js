// How long something still takes: the server's guesses count down between what it says.

import { duration, t } from "./i18n.js";

const FEW = 5; // seconds below which no number is said
const LATE = 10; // seconds past its end after which something takes longer than usual, at least
const SHARE = 0.2; // the same over what it has taken
const MUCH = 30; // seconds of the other stages from which on they are said although one is late

const known = (value) => Number.isFinite(value);

/** Keep when a stage will end; `old` is what was known of it before, `now` in milliseconds. */
export function heardStage(stage, old = null, now = performance.now()) {
  // Nothing is left, and it is not done: it is late since then.
  const late = old?.state === "running" && stage.left <= 0 && known(old.due) && old.due < now;
  stage.due = known(stage.left) ? (late ? old.due : now + 1000 * stage.left) : null;
}

/** Keep when a job's stages began and will end; `before` is what was known of it. */
export function heardJob(job, before = null, now = performance.now()) {
  for (const stage of job.stages) {
    stage.begun = now - 1000 * (stage.seconds ?? 0);
    heardStage(stage, before?.stages.find(({ name }) => name === stage.name), now);
  }
}

/** Seconds that a stage goes on; below 0 past its end, null where nobody knows. */
export function remaining(stage, now = performance.now()) {
  if (stage.state === "waiting") return stage.left;
  if (stage.state !== "running") return 0;
  return known(stage.due) ? (stage.due - now) / 1000 : null;
}

const took = (stage, now) => (stage.state === "running" ? (now - stage.begun) / 1000 : (stage.seconds ?? 0));

function isLate(stage, now) {
  const left = remaining(stage, now);
  return stage.state === "running" && left !== null && -left > Math.max(LATE, SHARE * took(stage, now));
}

function inWords(seconds, late) {
  if (late) return t("time.longer");
  return seconds >= FEW ? t("time.left", { time: duration(seconds) }) : t("time.few");
}

/** The same in words. */
export function leftOfStage(stage, now = performance.now()) {
  const left = remaining(stage, now);
  return left === null ? "…" : inWords(left, isLate(stage, now));
}

/** Seconds of all stages, null where nobody knows. */
function leftOf(job, now) {
  const left = job.stages.map((stage) => remaining(stage, now));
  return left.length && left.every(known) ? left.reduce((sum, value) => sum + Math.max(0, value), 0) : null;
}

/** What a job's stages have left, in words. */
export function leftOfJob(job, now = performance.now()) {
  const left = leftOf(job, now);
  if (left === null) return "";
  const late = job.stages.some((stage) => isLate(stage, now));
  return late && left >= MUCH ? t("time.more", { time: duration(left) }) : inWords(left, late);
}

/** How much of a job is done, 0 to 1, by time; null before it is known. */
export function shareOf(job, now = performance.now()) {
  if (job.state !== "running") return job.progress;
  const left = leftOf(job, now);
  if (left === null) return job.progress;
  const spent = job.stages.reduce((sum, stage) => sum + took(stage, now), 0);
  return Math.min(0.99, Math.max(job.progress ?? 0, spent / Math.max(spent + left, 1e-6)));
}

/** A job's state in a word or two: what waits has no share. */
export function standingOf(job) {
  const share = shareOf(job);
  return job.state === "running" && share !== null
    ? `${t("job.running")} ${Math.round(100 * share)} %`
    : t(`job.${job.state}`);
}
