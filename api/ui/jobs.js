// A job's progress, by server-sent events where the service has them, else by asking again and again.

import { $ } from "./dom.js";
import { getJson, offers, sendJson } from "./http.js";

const EVERY_MS = 700;
const EVENTS = "/v1/jobs/{job}/events";
let current = 0; // the newest watch owns the bar

export async function watch(path) {
  const mine = ++current;
  $("job").hidden = false;
  $("job-stop").onclick = () => sendJson("DELETE", path).catch(() => {}); // it may have ended just now
  let job = await getJson(path);
  const next = (await offers(EVENTS)) ? changes(path) : null;
  while (!ended(job) && mine === current) {
    show(job);
    await (next?.isOpen() ? Promise.race([next.changed(), pause(5 * EVERY_MS)]) : pause(EVERY_MS));
    job = await getJson(path);
  }
  next?.close();
  if (mine === current) $("job").hidden = true;
  return job;
}

const ended = (job) => ["successful", "failed", "dismissed"].includes(job.status);
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// The events say that something changed; what, is always read from the job itself.
function changes(path) {
  const source = new EventSource(`${path}/events`);
  let wake = () => {};
  for (const kind of ["progress", "tile", "done", "message"]) source.addEventListener(kind, () => wake());
  source.onerror = () => source.close(); // the slow way remains
  return {
    isOpen: () => source.readyState !== EventSource.CLOSED,
    changed: () => new Promise((resolve) => (wake = resolve)),
    close: () => source.close(),
  };
}

function show(job) {
  const { done, total } = job.tiles ?? {};
  const bar = $("job-bar");
  if (total) {
    bar.max = total;
    bar.value = done;
  } else {
    bar.removeAttribute("value");
  }
  const left = job.eta_s ? `, about ${Math.ceil(job.eta_s)} s left` : "";
  $("job-words").textContent = total ? `${Math.floor((100 * done) / total)} % of the field${left}` : "The field waits for its turn";
}
