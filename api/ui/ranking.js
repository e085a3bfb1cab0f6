// Triplets at a place, best first, and those that something keeps from being better; a click shows one.

import { $, make, say } from "./dom.js";
import { squareMetres } from "./format.js";
import { set } from "./state.js";

const MISSED = 3; // more would be a list of the same landmark's neighbours
const CRITERIA = { area: "area of the ellipse", max_axis: "major axis", trace: "sum of variances" };
const BLOCKING = {
  too_near: "too near",
  too_far: "too far",
  turned_away: "faces away",
  hidden: "hidden",
  muted: "in a muted sector",
  outside_view: "outside the view",
};

export function ranking(point) {
  const { triplets = [], missed = [], criterion } = point?.ranking ?? {};
  $("ranking").hidden = !triplets.length;
  $("ranking-by").textContent = CRITERIA[criterion] ?? "";
  $("ranking-rows").replaceChildren(...triplets.map((one, k) => row(one, String(k + 1), "")));
  // Only what would be better than what there is.
  const best = triplets[0]?.area95_m2 ?? Infinity;
  const better = missed.filter((one) => one.area95_m2 < best).slice(0, MISSED);
  $("missed").hidden = !better.length;
  $("missed-rows").replaceChildren(...better.map((one) => row(one, "", why(one))));
  const shown = point?.triplet?.join();
  press(buttons().find((button) => button.textContent.split(", ").join() === shown));
}

const buttons = () => [...$("ranking").querySelectorAll("button"), ...$("missed").querySelectorAll("button")];

const why = ({ blocking }) => Object.entries(blocking).map(([id, status]) => `${id} ${BLOCKING[status] ?? status}`).join(", ");

function row(one, rank, blocked) {
  const names = one.triplet.join(", ");
  const choose = make("button", { type: "button", className: "row", textContent: names });
  choose.addEventListener("click", () => {
    set({ triplet: one });
    press(choose);
    say(`Shown: ${names}, area ${squareMetres(one.area95_m2)}${blocked ? `; ${blocked}` : ""}`);
  });
  const told = make("td", {}, choose, blocked ? make("span", { className: "soft", textContent: ` ${blocked}` }) : null);
  const area = `${squareMetres(one.area95_m2)}${one.valid === false ? " (not valid)" : ""}`;
  return make("tr", {}, make("td", { textContent: rank }), told, make("td", { textContent: area }));
}

function press(chosen) {
  for (const button of buttons()) button.ariaPressed = String(button === chosen);
}
