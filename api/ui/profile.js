// r95 along both routes, as a small chart of our own: two lines, gaps without a fix, the bound. Logarithmic where
// the routes differ by more than a linear axis can show.

import { $, svg } from "./dom.js";
import { metres, significant, ticks } from "./format.js";
import { set, state } from "./state.js";

const LEFT = 52;
const RIGHT = 12;
const TOP = 10;
const BOTTOM = 30;
const LOG_FROM = 8; // largest by smallest value
let scaled = null; // {width, longest}: pointer to metres

export function startProfile() {
  const chart = $("profile");
  chart.addEventListener("pointermove", (event) => {
    if (!scaled) return;
    const x = event.clientX - chart.getBoundingClientRect().left;
    const s = ((x - LEFT) / (scaled.width - LEFT - RIGHT)) * scaled.longest;
    follow(s >= 0 && s <= scaled.longest ? s : null);
  });
  chart.addEventListener("pointerleave", () => follow(null));
  chart.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !scaled) return;
    event.preventDefault();
    follow(Math.min(scaled.longest, Math.max(0, (state.along ?? 0) + (step * scaled.longest) / 60)));
  });
  new ResizeObserver(showProfile).observe(chart);
}

// What the chosen route is called beside the shortest one.
export function nameOf(plan, route) {
  if (plan?.routes.length > 1) return `route ${route + 1}`;
  return plan?.request.objective.kind === "shortest" ? "within the bounds" : "low uncertainty";
}

function series() {
  const { plan, route } = state;
  return [
    { path: plan?.shortest_baseline?.path, kind: "shortest", name: "shortest" },
    { path: plan?.routes[route]?.path, kind: "chosen", name: nameOf(plan, route) },
  ].filter(({ path }) => path?.length);
}

export function showProfile() {
  const lines = series();
  $("profile-box").hidden = !lines.length;
  scaled = null;
  if (!lines.length) return;
  $("profile-chosen").textContent = nameOf(state.plan, state.route);
  $("profile-shortest").hidden = !lines.some(({ kind }) => kind === "shortest");
  const chart = $("profile");
  const [width, height] = [chart.clientWidth || 600, chart.clientHeight || 130];
  const longest = Math.max(1e-9, ...lines.map(({ path }) => path.at(-1).s_m));
  const bound = state.plan.request.constraints.max_r95_m;
  const values = lines.flatMap(({ path }) => path.map((p) => p.r95_m).filter((v) => v > 0));
  const [least, most] = values.length ? [Math.min(...values), Math.max(...values)] : [0.01, 0.1];
  const scale = most > LOG_FROM * least ? "log" : "linear";
  const highest = 1.08 * Math.max(most, bound !== null && bound < 3 * most ? bound : 0);
  const lowest = scale === "log" ? least / 1.15 : 0;
  scaled = { width, longest };
  const x = (s) => LEFT + (s / longest) * (width - LEFT - RIGHT);
  const share = (v) => (scale === "log" ? Math.log(v / lowest) / Math.log(highest / lowest) : v / highest);
  const y = (value) => height - BOTTOM - share(value) * (height - TOP - BOTTOM);
  const parts = axes({ width, height, longest, lowest, highest, scale, x, y });
  if (bound !== null && bound <= highest && bound > lowest) {
    parts.push(svg("line", { x1: LEFT, x2: width - RIGHT, y1: y(bound), y2: y(bound), class: "bound" }));
    parts.push(text(width - RIGHT, y(bound) - 4, "bound", "end"));
  }
  for (const { path, kind } of lines) {
    parts.push(svg("path", { d: curve(path, x, y), class: `curve ${kind}` }));
    parts.push(...gaps(path, x, height - BOTTOM, kind));
  }
  parts.push(svg("line", { id: "profile-at", y1: TOP, y2: height - BOTTOM, class: "at", visibility: "hidden" }));
  chart.replaceChildren(...parts);
  chart.setAttribute("viewBox", `0 0 ${width} ${height}`);
  chart.setAttribute("aria-label", spoken(lines));
}

function axes({ width, height, longest, lowest, highest, scale, x, y }) {
  const parts = [];
  const inMillimetres = highest < 1;
  for (const value of ticks(lowest, highest, scale)) {
    parts.push(svg("line", { x1: LEFT, x2: width - RIGHT, y1: y(value), y2: y(value), class: "grid" }));
    const shown = inMillimetres ? 1000 * value : value;
    parts.push(text(LEFT - 6, y(value) + 4, String(Number(shown.toPrecision(3))), "end"));
  }
  for (const s of ticks(0, longest, "linear")) {
    parts.push(svg("line", { x1: x(s), x2: x(s), y1: height - BOTTOM, y2: height - BOTTOM + 4, class: "axis" }));
    parts.push(text(x(s), height - BOTTOM + 16, String(Number(s.toPrecision(3))), "middle"));
  }
  parts.push(text(width - RIGHT, height - 2, "way, m", "end"));
  const title = text(0, 0, `r95, ${inMillimetres ? "mm" : "m"}`, "middle");
  title.setAttribute("transform", `translate(12 ${(height - BOTTOM + TOP) / 2}) rotate(-90)`);
  parts.push(title);
  return parts;
}

function text(x, y, content, anchor) {
  const element = svg("text", { x, y, "text-anchor": anchor, class: "tick" });
  element.textContent = content;
  return element;
}

function curve(path, x, y) {
  let pen = "M";
  let d = "";
  for (const p of path) {
    if (p.r95_m === null) {
      pen = "M";
      continue;
    }
    d += `${pen}${x(p.s_m).toFixed(1)} ${y(p.r95_m).toFixed(1)}`;
    pen = "L";
  }
  return d || "M0 0";
}

// Stretches without a fix, as thick bars on the axis.
function gaps(path, x, y, kind) {
  const bars = [];
  for (let k = 1; k < path.length; k += 1) {
    if (path[k].r95_m !== null && path[k - 1].r95_m !== null) continue;
    bars.push(svg("line", { x1: x(path[k - 1].s_m), x2: x(path[k].s_m), y1: y, y2: y, class: `gap ${kind}` }));
  }
  return bars;
}

function follow(s) {
  set({ along: s });
  const at = $("profile-at");
  if (!at || !scaled) return;
  at.setAttribute("visibility", s === null ? "hidden" : "visible");
  if (s === null) {
    $("profile-words").textContent = "";
    return;
  }
  const px = LEFT + (s / scaled.longest) * (scaled.width - LEFT - RIGHT);
  at.setAttribute("x1", px);
  at.setAttribute("x2", px);
  const values = series().map(({ path }) => {
    const p = path.find((q) => q.s_m >= s);
    return p ? (p.r95_m === null ? "no fix" : metres(p.r95_m)) : "at the goal";
  });
  // In the order of the caption: chosen, shortest.
  $("profile-words").textContent = `at ${significant(s)} m: ${values.reverse().join(" and ")}`;
}

function spoken(lines) {
  const said = lines.map(({ path, name }) => {
    const known = path.filter((p) => p.r95_m !== null);
    const worst = known.reduce((a, b) => (b.r95_m > a.r95_m ? b : a), known[0]);
    return worst ? `${name}: worst ${metres(worst.r95_m)} after ${significant(worst.s_m)} m` : `${name}: no fix`;
  });
  return `r95 along the routes. ${said.join("; ")}. Arrow keys walk along.`;
}
