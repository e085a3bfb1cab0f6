// A job's progress, as the service tells it: server-sent events, and asking again and again where they cannot be had.

import { $ } from "./dom.js";
import { getJson, sendJson } from "./http.js";

const EVERY_MS = 700;
const EARLY = 0.02; // of the work: what is left cannot be told from less
let current = 0; // the newest watch owns the bar
let leave = () => {}; // the stream of the one before

export async function watch(path) {
  const mine = ++current;
  const isWatched = () => mine === current;
  leave();
  $("job").hidden = false;
  $("job-stop").onclick = () => sendJson("DELETE", path).catch(() => {}); // it may have ended just now
  let job = await getJson(path);
  const told = (news) => {
    job = { ...job, ...news };
    if (isWatched()) show(job);
  };
  told({});
  if (!ended(job) && isWatched()) await stream(job.links.events, told);
  while (!ended(job) && isWatched()) {
    await pause(EVERY_MS);
    told(await getJson(path));
  }
  if (isWatched()) $("job").hidden = true;
  return job;
}

const ended = (job) => ["successful", "failed", "dismissed"].includes(job.status);
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// Until the job has ended, the service refuses the stream, or another job is watched. A stream that was cut is
// taken up again by the browser, from the last event that it saw.
function stream(path, told) {
  return new Promise((resolve) => {
    const source = new EventSource(path);
    leave = () => {
      source.close();
      resolve();
    };
    const read = (event) => JSON.parse(event.data);
    source.addEventListener("tile", (event) => told({ tiles: read(event) }));
    source.addEventListener("progress", (event) => told(read(event)));
    source.addEventListener("done", (event) => {
      told(read(event));
      leave();
    });
    source.addEventListener("error", () => {
      if (source.readyState === EventSource.CLOSED) leave();
      else $("job-words").textContent = "The service does not answer; trying again …";
    });
  });
}

function show(job) {
  const { done, total } = job.tiles;
  const bar = $("job-bar");
  if (total) {
    bar.max = total;
    bar.value = done;
  } else {
    bar.removeAttribute("value");
  }
  const left = job.eta_s && done > EARLY * total ? `, about ${Math.ceil(job.eta_s)} s left` : "";
  $("job-words").textContent = total ? `${Math.floor((100 * done) / total)} % of the field${left}` : "The field waits for its turn";
}
