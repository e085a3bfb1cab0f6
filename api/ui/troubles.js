// Problems in words, with what would help.

import { $, make, say } from "./dom.js";
import { keepKey } from "./http.js";

// helps: {use_place(p), watch(job), order(body), rebase(map)}: what a hint can be turned into here
export function showTrouble(where, error, helps = {}) {
  if (error.name === "AbortError") return;
  const box = $(where);
  const title = error.title || "Something failed in this page";
  box.replaceChildren(make("strong", { textContent: title }), make("p", { textContent: error.message }));
  if (error.limit) box.append(make("p", { textContent: error.limit }));
  const { nearest_free: free, job, order, map } = error.hint ?? {};
  if (free && helps.use_place) {
    const place = { x: free.x_m, y: free.y_m };
    box.append(button(`Use the nearest free place (${place.x.toFixed(2)}, ${place.y.toFixed(2)})`, () => helps.use_place(place)));
  }
  if (job && helps.watch) box.append(button("Watch the job that computes it", () => helps.watch(job)));
  if (order && helps.order) box.append(button("Build this field again", () => helps.order(order)));
  if (map && helps.rebase) box.append(button("Put my changes on the newest version", () => helps.rebase(map.split("/").at(-1))));
  if (error.status === 401) box.append(keyForm());
  box.hidden = false;
  say(`${title}. ${error.message}`);
  if (!error.title) console.error(error);
}

export function clearTrouble(where) {
  $(where).hidden = true;
  $(where).replaceChildren();
}

function button(text, act) {
  return make("button", { type: "button", textContent: text, onclick: act });
}

function keyForm() {
  const key = make("input", { type: "password", autocomplete: "off", required: true });
  const form = make("form", {}, make("label", {}, "API key ", key), make("button", { textContent: "Use this key" }));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    keepKey(key.value);
    location.reload();
  });
  return form;
}
