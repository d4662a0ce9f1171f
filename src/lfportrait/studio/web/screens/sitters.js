// Screen 1: the sitters, and whether this machine is ready.

import { chooser, takeFiles } from "../drop.js";
import { get, leaveScreen, post, send } from "../api.js";
import { ask, fill, h, heading, icon } from "../dom.js";
import { named } from "../naming.js";
import { said, size, t } from "../i18n.js";
import { action, fail, preferences, say, tool } from "../shell.js";
import { plainName, uploadsOf } from "../uploads.js";
import {
  isLive,
  jobsOf,
  keepJob,
  keepProject,
  listen,
  listenNoMore,
  on,
  project,
  state,
  tell,
} from "../state.js";
import { leftOfJob, standingOf } from "../times.js";

const PICTURES = ".jpg,.jpeg,.png,.webp,.tif,.tiff,.bmp,.avif,.heic,.heif,.hif";

export async function showSitters(root) {
  const list = h("ul.sitters", { "aria-label": t("step.sitters") });
  const machine = h("section.machine.stack");
  const draw = () => {
    fill(
      list,
      [...state.projects].sort((one, other) => other.changed - one.changed).map(card),
      h("li", newSitter()),
    );
    list.classList.toggle("first", state.projects.length === 0);
  };
  fill(
    root,
    heading(t("sitters.title"), h("p.lead", t("sitters.lead"))),
    state.projects.length === 0 && welcome(),
    list,
    machine,
    h(
      "footer.row.between.soft.small",
      h("p", t("sitters.folder", { folder: state.folder, version: state.version })),
      end(),
    ),
    preferences(() => dispatchEvent(new HashChangeEvent("hashchange"))),
  );
  draw();
  const look = () => drawMachine(machine);
  look();
  get("/api/doctor")
    .then(({ checks }) => {
      machine.checks = checks;
      look();
    })
    .catch(fail);
  const ends = [
    on("project", draw),
    on("project-removed", draw),
    on("job", () => {
      draw();
      look();
    }),
    on("state", () => {
      draw();
      look();
    }),
    takeFiles(t("sitters.release"), (files) => fromFiles(files).catch(fail)),
  ];
  const clock = setInterval(() => count(list), 1000);
  return () => {
    clearInterval(clock);
    for (const each of ends) each();
  };
}

function welcome() {
  return h(
    "section.card.welcome.row",
    icon("spark"),
    h("div.stack", h("h2", t("welcome.title")), h("p.soft", t("welcome.text"))),
    h(
      "div.row",
      photoButton("main"),
      action(t("sitters.demo"), { kind: "quiet" }, () => create(t("demo.name"), true)),
    ),
  );
}

/** Choose one photo, which is enough for a head. */
function photoButton(kind) {
  const looks = { kind, drawing: "photos" };
  return h(
    "span",
    chooser(t("sitters.photo"), looks, { accept: PICTURES }, (files) => fromFiles(files).catch(fail)),
  );
}

/** A sitter of files: of one photo the head is made at once, of others after a look at them. */
async function fromFiles(files) {
  if (!files.length) return;
  const alone =
    files.length === 1 && PICTURES.split(",").some((end) => files[0].name.toLowerCase().endsWith(end));
  const name = alone ? plainName(files[0].name).replace(/\.[^.]*$/, "") : "";
  const item = alone ? await createFree(name) : await asked();
  if (!item) return;
  keepProject(item);
  const uploads = uploadsOf(item.id);
  const sent = uploads.add(files);
  if (!alone) {
    location.hash = `#photos/${item.id}`;
    return;
  }
  await sent;
  const [refused] = uploads.figures().wrong;
  if (refused) {
    location.hash = `#photos/${item.id}`;
    return;
  }
  keepJob(await post("/api/jobs", { kind: "head", project: item.id }));
  location.hash = `#making/${item.id}`;
}

/** A new sitter whose name is asked for. */
function asked() {
  return named(t("sitters.new"), "", t("create"), (name) => post("/api/projects", { name, demo: false }));
}

/** A new sitter of a name, or of the next one that is free. */
async function createFree(name) {
  for (let number = 1; ; number++) {
    try {
      return await post("/api/projects", { name: number > 1 ? `${name} ${number}` : name, demo: false });
    } catch (error) {
      if (error.code === "bad_name") return asked();
      if (error.code !== "exists") throw error;
    }
  }
}

/** What the screen of making shows of a sitter: no files, and no photos that are looked at. */
const making = (item) => jobsOf(item.id).find((job) => isLive(job) && ["head", "fine"].includes(job.kind));

/** What is to be done next for a sitter: a screen and a line. */
function standing(item) {
  const job = making(item);
  if (job) return ["making", standingOf(job), ""];
  if (item.has.styled || item.version) return ["portrait", t("sitter.painted"), "good"];
  if (item.has.field) return ["style", t("sitter.head"), "good"];
  if (item.photos || item.video) return ["photos", t("sitter.photos", { n: item.photos }), ""];
  return [item.demo ? "making" : "photos", t("sitter.new"), ""];
}

function card(item) {
  const [screen, text, kind] = standing(item);
  return h(
    "li.sitter",
    { "data-sitter": item.id },
    h(
      "a.open",
      { href: `#${screen}/${item.id}` },
      item.thumbnail
        ? h("img", { src: item.thumbnail, alt: "", loading: "lazy" })
        : h("span.blank", icon("sitters")),
      h("strong.some", { text: item.name, title: item.name }),
      h("span.tag", { class: kind, text }),
      making(item) && h("span.when.small.soft", leftWords(item)),
    ),
    h(
      "div.row",
      tool("pencil", t("sitter.rename", { name: item.name }), () => rename(item)),
      tool("trash", t("sitter.remove", { name: item.name }), () => remove(item)),
    ),
  );
}

function leftWords(item) {
  const job = making(item);
  return job?.state === "running" ? leftOfJob(job) : "";
}

/** The time that is left counts down between what the server says. */
function count(list) {
  for (const each of list.querySelectorAll("[data-sitter]")) {
    const item = project(each.dataset.sitter);
    const left = each.querySelector(".when");
    if (!item || !left) continue;
    left.textContent = leftWords(item);
    each.querySelector(".tag").textContent = standing(item)[1];
  }
}

function newSitter() {
  return h(
    "div.new-sitter.stack",
    action(t("sitters.new"), { kind: "main", drawing: "plus" }, () =>
      named(t("sitters.new"), "", t("create"), (name) => create(name, false)),
    ),
    state.projects.length > 0 && photoButton("quiet"),
    state.projects.length > 0 &&
      action(t("sitters.demo"), { kind: "quiet" }, () => create(t("demo.name"), true)),
  );
}

async function create(name, demo) {
  const item = await post("/api/projects", { name, demo }).catch((error) => {
    // The built-in head is made once; after that it is opened.
    const there = demo && error.code === "exists" && state.projects.find((each) => each.demo);
    if (!there) throw error;
    return there;
  });
  keepProject(item);
  if (demo && !item.has.field && !jobsOf(item.id).some(isLive))
    keepJob(await post("/api/jobs", { kind: "head", project: item.id }));
  location.hash = `#${standing(item)[0]}/${item.id}`;
}

async function rename(item) {
  await named(t("sitter.rename", { name: item.name }), item.name, t("save"), async (name) => {
    if (name !== item.name) keepProject(await send("PATCH", `/api/projects/${item.id}`, { name }));
  });
}

async function remove(item) {
  const answer = await ask(
    t("sitter.remove", { name: item.name }),
    h("p", t("sitter.remove.text", { name: item.name, size: size(item.size_bytes) })),
    [["yes", t("remove"), "danger"]],
  );
  if (!answer) return;
  const { trash } = await send("DELETE", `/api/projects/${item.id}`, { confirm: item.name });
  state.projects = state.projects.filter(({ id }) => id !== item.id);
  tell("state");
  say(t("sitter.removed", { name: item.name }), {
    back: async () => {
      const { id } = keepProject(await post("/api/trash", { name: trash }));
      document.querySelector(`[data-sitter="${id}"] a`)?.focus();
    },
  });
}

/** What the doctor found, and networks that are not here yet. */
function drawMachine(box) {
  const missing = state.networks.filter(({ needed, present }) => needed && !present);
  const loading = state.jobs.find((job) => job.kind === "networks" && isLive(job));
  const { checks } = box;
  const worst = checks?.some(({ grade }) => grade === "bad")
    ? "bad"
    : checks?.some(({ grade }) => grade === "fair")
      ? "fair"
      : "good";
  fill(
    box,
    missing.length > 0 &&
      h(
        "div.note.fair",
        icon("fair"),
        h(
          "div.stack",
          h("h2", t("networks.title", { n: missing.length })),
          h(
            "p",
            t("networks.text", {
              size: size(missing.reduce((sum, { size_bytes: bytes }) => sum + bytes, 0)),
            }),
          ),
          h(
            "ul",
            missing.map((each) =>
              h("li.small", `${each.name}: ${said(each.for)} (${size(each.size_bytes)}, ${each.licence})`),
            ),
          ),
          loading
            ? h("progress", { max: 1, value: loading.progress ?? null, "aria-label": t("networks.loading") })
            : h(
                "div",
                action(t("networks.get"), { drawing: "download" }, async () => {
                  keepJob(await post("/api/networks", { names: missing.map(({ name }) => name) }));
                }),
              ),
        ),
      ),
    h(
      "details.card",
      { open: box.querySelector("details")?.open ?? worst === "bad" },
      h(
        "summary",
        h(
          "span.row",
          icon(checks ? worst : "info"),
          h("strong", checks ? t(`doctor.${worst}`) : t("doctor.wait")),
        ),
      ),
      h(
        "ul.checks",
        (checks ?? []).map(({ name, grade, text, advice }) =>
          h(
            "li.note",
            { class: grade },
            icon(grade),
            h(
              "div",
              h(
                "p",
                h("span.unseen", `${t(`check.${grade}`)}: `),
                h("strong", said(name)),
                ` · ${said(text)}`,
              ),
              advice && h("p.small.soft", said(advice)),
            ),
          ),
        ),
      ),
    ),
  );
}

function end() {
  return action(t("shutdown"), { kind: "quiet" }, async () => {
    const running = state.jobs.some(({ state: how }) => how === "running");
    const answer = await ask(t("shutdown"), h("p", t(running ? "shutdown.running" : "shutdown.text")), [
      ["yes", t("shutdown"), "main"],
    ]);
    if (!answer) return;
    listenNoMore();
    await post("/api/shutdown").catch((error) => {
      listen();
      throw error;
    });
    leaveScreen(); // what is still asked for gets no answer
    fill(document.getElementById("main"), h("div.empty", h("h1", t("shutdown.done"))));
  });
}
