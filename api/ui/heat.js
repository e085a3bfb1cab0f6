// The field over the floor: pictures of what is in view, made by the service, so that the number of cells does
// not matter here. The last picture stays, moved along, until the next one is there.

import { busy } from "./dom.js";
import { getJson, getPicture, query } from "./http.js";
import { state } from "./state.js";

const MARGIN = 0.2; // more than is in view, so that small moves show no edge
const WAIT_MS = 140; // after the last move
const MOST_PIXELS = 1.6e6;

export class Heat {
  constructor(redraw, failed) {
    this.redraw = redraw;
    this.failed = failed;
    this.clear();
  }

  clear() {
    this.stop?.abort();
    clearTimeout(this.timer);
    this.asked = "";
    this.overview = null; // of the whole map, small: shown where the window has nothing yet
    this.window = null;
  }

  // colours: {metric, scale, colormap, range, heading}
  show(field, colours, view) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load(field, colours, view), this.overview ? WAIT_MS : 0);
  }

  async load(field, colours, view) {
    const bounds = field.bounds;
    const all = [bounds.x_min_m, bounds.y_min_m, bounds.x_max_m, bounds.y_max_m];
    const box = view.window(MARGIN);
    if (box[0] >= all[2] || box[1] >= all[3] || box[2] <= all[0] || box[3] <= all[1]) return;
    const base = address(field, colours);
    const density = Math.min(window.devicePixelRatio || 1, 2);
    let width = Math.round((box[2] - box[0]) * view.scale * density);
    let height = Math.round((box[3] - box[1]) * view.scale * density);
    const less = Math.min(1, Math.sqrt(MOST_PIXELS / (width * height)));
    width = Math.max(16, Math.round(width * less));
    height = Math.max(16, Math.round(height * less));
    // Same scale on both axes to the last digit: the service would leave a margin otherwise.
    const high = ((box[2] - box[0]) * height) / width;
    const exact = [box[0], view.y - high / 2, box[2], view.y + high / 2];
    const asked = `${base}&${query({ width, height, bbox: exact.map((v) => v.toFixed(4)).join(",") })}`;
    if (asked === this.asked) return;
    this.stop?.abort();
    this.stop = new AbortController();
    this.asked = asked;
    try {
      if (this.overview?.base !== base) {
        const picture = await busy(getPicture(`${base}&max_size=700`, { signal: this.stop.signal }));
        this.overview = { base, picture, box: all };
        this.window = null;
        this.redraw();
      }
      const picture = await busy(getPicture(asked, { signal: this.stop.signal }));
      this.window = { picture, box: exact };
      this.redraw();
    } catch (error) {
      if (error.name === "AbortError") return;
      this.asked = "";
      this.failed(error);
    }
  }

  draw(context, view, bounds, opacity) {
    context.save();
    const [left, top] = view.toScreen({ x: bounds.x_min_m, y: bounds.y_max_m });
    context.beginPath();
    context.rect(
      left,
      top,
      (bounds.x_max_m - bounds.x_min_m) * view.scale,
      (bounds.y_max_m - bounds.y_min_m) * view.scale,
    );
    context.clip();
    context.globalAlpha = opacity;
    const isCovered = this.window && covers(this.window.box, view.window(), bounds);
    for (const layer of isCovered ? [this.window] : [this.overview, this.window]) {
      if (!layer) continue;
      const [x, y] = view.toScreen({ x: layer.box[0], y: layer.box[3] });
      context.imageSmoothingEnabled = false; // cells have edges
      context.drawImage(
        layer.picture,
        x,
        y,
        (layer.box[2] - layer.box[0]) * view.scale,
        (layer.box[3] - layer.box[1]) * view.scale,
      );
    }
    context.restore();
  }
}

function covers(box, seen, bounds) {
  return (
    box[0] <= Math.max(seen[0], bounds.x_min_m) &&
    box[1] <= Math.max(seen[1], bounds.y_min_m) &&
    box[2] >= Math.min(seen[2], bounds.x_max_m) &&
    box[3] >= Math.min(seen[3], bounds.y_max_m)
  );
}

function address(field, { metric, scale, colormap, range, heading }) {
  const shown = { metric, scale, colormap_name: colormap, rescale: range.join(","), heading: headingOf(field, heading) };
  return `${field.links.heatmap}?${query({ ...shown, legend: false, landmarks: false, v: state.facts.renderer })}`;
}

// Fields of one heading take none.
export const headingOf = (field, heading) => (field.headings > 1 ? heading : null);

// Ends of the colours that suit the whole field: 1st and 99th percentile. Every part of the map is then shown in
// the same colours.
export async function suitableRange(field, metric, scale, heading) {
  const asked = query({ metric, percentiles: "1,99", bins: 1, heading: headingOf(field, heading) });
  const { percentiles } = await busy(getJson(`${field.links.statistics}?${asked}`));
  let [low, high] = percentiles.map((found) => found.value);
  if (high === null) return [0.01, 1]; // no value anywhere
  if (scale === "linear") low = 0;
  else if (low <= 0) low = high > 0 ? high / 1000 : 0.01; // of counts and shares
  if (!(high > low * 1.001)) high = low > 0 ? low * 2 : 1;
  return [Number(low.toPrecision(2)), Number(high.toPrecision(2))];
}
