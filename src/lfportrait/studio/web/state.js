// What the server holds, as this page knows it, kept up to date by its events.

import { get, post, reached } from "./api.js";
import { heardJob, heardStage } from "./times.js";

const KINDS = [
  "hello",
  "reset",
  "job",
  "progress",
  "job-removed",
  "project",
  "project-removed",
  "photos",
  "styles",
  "versions",
  "exports",
  "disk",
  "notice",
];

export const state = {
  projects: [],
  jobs: [],
  networks: [],
  version: "",
  folder: "",
  free_bytes: null,
  event: 0,
};
const hub = new EventTarget();

/** Call `act(data)` for events of a kind, until the function that this returns is called. */
export function on(kind, act) {
  const listener = (event) => act(event.detail);
  hub.addEventListener(kind, listener);
  return () => hub.removeEventListener(kind, listener);
}

export function tell(kind, data = null) {
  hub.dispatchEvent(new CustomEvent(kind, { detail: data }));
}

export const project = (id) => state.projects.find((each) => each.id === id) ?? null;
/** Jobs of a sitter that run or wait, or all of them. */
export const jobsOf = (id) => state.jobs.filter((each) => each.project === id);
/** The job that makes a version of a sitter fine, or undefined. */
export const fineJob = (id, version) =>
  jobsOf(id).find((job) => job.kind === "fine" && job.version === version && isLive(job));
export const isLive = (job) => ["waiting", "running", "paused", "stopped"].includes(job.state);

function place(list, item) {
  const index = list.findIndex(({ id }) => id === item.id);
  if (item.stages) heardJob(item, list[index]);
  if (index < 0) list.push(item);
  else list[index] = item;
}

/** Keep an answer that came by a request before its event does. */
export function keepProject(item) {
  place(state.projects, item);
  tell("project", item);
  return item;
}

export function keepJob(item) {
  place(state.jobs, item);
  tell("job", item);
  return item;
}

/** Keep the list of all jobs. */
export function keepJobs(jobs) {
  for (const job of jobs) heardJob(job, state.jobs.find(({ id }) => id === job.id));
  state.jobs = jobs;
}

/** Trade the token of the address for a cookie, once. */
export async function enter() {
  const token = /^#token=(.+)$/.exec(location.hash)?.[1];
  if (!token) return;
  await post("/api/session", { token: decodeURIComponent(token) });
  history.replaceState(null, "", location.pathname);
}

export async function refresh() {
  // Not for a screen: it is needed whichever is seen. What has happened since is asked for again.
  let found = await get("/api/state", null);
  for (let more = 3; more && found.event < state.event; more--) found = await get("/api/state", null);
  const { jobs, ...others } = found;
  Object.assign(state, others);
  keepJobs(jobs);
  tell("state", state);
}

const HEARD = {
  job: (data) => place(state.jobs, data),
  project: (data) => place(state.projects, data),
  "job-removed": ({ job }) => {
    state.jobs = state.jobs.filter(({ id }) => id !== job);
  },
  "project-removed": (data) => {
    state.projects = state.projects.filter(({ id }) => id !== data.project);
  },
  disk: (data) => {
    state.free_bytes = data.free_bytes;
  },
  progress: (data) => {
    const job = state.jobs.find(({ id }) => id === data.job);
    const stage = job?.stages.find(({ name }) => name === data.stage);
    if (!stage) return;
    Object.assign(stage, { progress: data.progress, note: data.note, left: data.left });
    Object.assign(job, { progress: data.total_progress, left: data.total_left });
    for (const other of job.stages) other.left = data.waiting?.[other.name] ?? other.left;
    heardStage(stage, stage);
  },
};

let source = null;

/** The studio is ended by this page: that it does not answer is no news. */
export function listenNoMore() {
  source?.close();
  source = null;
}

/** Listen to the server for as long as the page is open; EventSource itself comes back after a break. */
export function listen() {
  const stream = new EventSource(`/api/events?after=${state.event}`);
  source = stream;
  stream.onopen = () => reached(true);
  stream.onerror = async () => {
    if (stream.readyState !== EventSource.CLOSED) return reached(false);
    // The browser gives up by itself where the answer is no stream: another answer says why. A studio
    // that was started again lets pages in that come by its new address; the key is then this page's, too.
    const why = await get("/api/state", null).then(
      () => null,
      (error) => error,
    );
    if (why?.code === "no_session") tell("notice", why);
    setTimeout(() => source === stream && listen(), 3000);
  };
  for (const kind of KINDS) {
    stream.addEventListener(kind, async (event) => {
      const data = JSON.parse(event.data || "null");
      // What was on its way while all was asked for (`refresh`) is known already, or out of date. Progress
      // has no number of its own.
      const number = Number(event.lastEventId);
      if (kind === "progress" || number > state.event) HEARD[kind]?.(data);
      if (kind === "reset" || number > state.event) state.event = number;
      if (kind === "reset") await refresh().catch(() => {});
      tell(kind, data);
    });
  }
}
