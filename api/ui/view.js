// The window on the map: world in metres (y up) to canvas in CSS pixels (y down).

export class View {
  x = 0; // of the centre, m
  y = 0;
  scale = 10; // px per m
  width = 1;
  height = 1;

  toScreen(p) {
    return [this.width / 2 + (p.x - this.x) * this.scale, this.height / 2 - (p.y - this.y) * this.scale];
  }

  toWorld(px, py) {
    return { x: this.x + (px - this.width / 2) / this.scale, y: this.y - (py - this.height / 2) / this.scale };
  }

  fit(bounds) {
    const wide = bounds.x_max_m - bounds.x_min_m;
    const high = bounds.y_max_m - bounds.y_min_m;
    this.x = bounds.x_min_m + wide / 2;
    this.y = bounds.y_min_m + high / 2;
    this.scale = Math.max(1e-3, Math.min((this.width - 24) / wide, (this.height - 24) / high));
  }

  move(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  // What is under (px, py) stays there.
  zoom(factor, px, py) {
    const before = this.toWorld(px, py);
    this.scale = Math.min(5000, Math.max(0.01, this.scale * factor));
    const after = this.toWorld(px, py);
    this.x += before.x - after.x;
    this.y += before.y - after.y;
  }

  window(margin = 0) {
    const half = [this.width / this.scale / 2, this.height / this.scale / 2].map((side) => side * (1 + margin));
    return [this.x - half[0], this.y - half[1], this.x + half[0], this.y + half[1]];
  }
}
