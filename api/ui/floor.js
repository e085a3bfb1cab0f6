// The floor below the field: polygons where the map has them (sharp at any scale), else its picture.

import { ask, getPicture } from "./http.js";

const FLOOR = "#fafaf8";
const WALL = "#303842";
const CLEAR = "#969ea8"; // stops the robot, not the view
export const OUTSIDE = "#e2e5e9";

export class Floor {
  bounds = null;
  picture = null;
  shapes = [];

  async load(map) {
    const floor = { bounds: map.bounds, picture: null, shapes: [] };
    if (map.links.world) floor.shapes = shapesOf(await (await ask(map.links.world)).json());
    else floor.picture = await getPicture(map.links.image);
    Object.assign(this, floor);
  }

  draw(context, view) {
    if (!this.bounds) return;
    const [left, top] = view.toScreen({ x: this.bounds.x_min_m, y: this.bounds.y_max_m });
    const wide = (this.bounds.x_max_m - this.bounds.x_min_m) * view.scale;
    const high = (this.bounds.y_max_m - this.bounds.y_min_m) * view.scale;
    context.fillStyle = OUTSIDE;
    context.fillRect(left, top, wide, high);
    if (this.picture) {
      context.imageSmoothingEnabled = view.scale * wide < this.picture.width;
      context.drawImage(this.picture, left, top, wide, high);
    }
    if (!this.shapes.length) return;
    context.save();
    context.translate(view.width / 2 - view.x * view.scale, view.height / 2 + view.y * view.scale);
    context.scale(view.scale, -view.scale);
    for (const { path, color } of this.shapes) {
      context.fillStyle = color;
      context.fill(path, "evenodd");
    }
    context.restore();
  }
}

function shapesOf(world) {
  const found = [];
  for (const { properties, geometry } of world.features) {
    if (geometry.type !== "Polygon" && geometry.type !== "MultiPolygon") continue;
    const isFloor = properties.kind === "floor";
    const color = isFloor ? FLOOR : properties.opaque === false ? CLEAR : WALL;
    const path = new Path2D();
    for (const polygon of geometry.type === "Polygon" ? [geometry.coordinates] : geometry.coordinates) {
      for (const ring of polygon) {
        ring.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
        path.closePath();
      }
    }
    found.push({ path, color, isFloor });
  }
  return found.sort((a, b) => b.isFloor - a.isFloor);
}
