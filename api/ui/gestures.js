// Mouse, touch and keys on the map, turned into moves of the view and places that are meant.

const TAP_PX = 5; // a finger is never still
const STEP_PX = 12; // of the keyboard's cursor
const FAR_PX = 60; // with Shift

// acts: {changed, tapped(world), hovered(world | null), grabs(world) -> bool, dragged(world), dropped, pressed(key, world)}
export function gestures(canvas, view, acts) {
  const down = new Map();
  let grabbed = false;
  let moved = false;
  let cursor = null; // of the keyboard, px

  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const place = at(event);
    down.set(event.pointerId, place);
    moved = down.size > 1;
    grabbed = down.size === 1 && acts.grabs(view.toWorld(...place));
    cursor = null;
  });

  canvas.addEventListener("pointermove", (event) => {
    const place = at(event);
    const before = down.get(event.pointerId);
    if (!before) {
      if (event.pointerType === "mouse") acts.hovered(view.toWorld(...place));
      return;
    }
    if (!moved && Math.hypot(place[0] - before[0], place[1] - before[1]) < TAP_PX) return;
    moved = true;
    if (grabbed) {
      acts.dragged(view.toWorld(...place));
    } else if (down.size === 2) {
      const other = [...down].find(([id]) => id !== event.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      const middle = [(place[0] + other[0]) / 2, (place[1] + other[1]) / 2];
      view.move((place[0] - before[0]) / 2, (place[1] - before[1]) / 2);
      view.zoom(gap(place) / Math.max(1, gap(before)), ...middle);
      acts.changed();
    } else {
      view.move(place[0] - before[0], place[1] - before[1]);
      acts.changed();
    }
    down.set(event.pointerId, place);
  });

  const lift = (event) => {
    const wasDown = down.delete(event.pointerId);
    if (!wasDown || down.size) return;
    if (event.type === "pointerup" && !moved) acts.tapped(view.toWorld(...at(event)));
    else if (grabbed) acts.dropped();
    grabbed = false;
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointerleave", () => acts.hovered(null));

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      view.zoom(Math.exp(-Math.max(-60, Math.min(60, event.deltaY)) / 240), ...at(event));
      acts.changed();
    },
    { passive: false },
  );

  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const step = event.shiftKey ? FAR_PX : STEP_PX;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    cursor ??= [view.width / 2, view.height / 2];
    if (event.key in moves) {
      cursor = [cursor[0] + moves[event.key][0], cursor[1] + moves[event.key][1]];
      keepInView();
      acts.hovered(view.toWorld(...cursor), true);
    } else if (event.key === "+" || event.key === "-") {
      view.zoom(event.key === "+" ? 1.4 : 1 / 1.4, ...cursor);
      acts.changed();
    } else if (event.key === "Enter") {
      acts.tapped(view.toWorld(...cursor));
    } else if (!acts.pressed(event.key, view.toWorld(...cursor))) {
      return;
    }
    event.preventDefault();
  });

  // The cursor never leaves the canvas: the map moves under it.
  function keepInView() {
    const inside = [Math.min(view.width - 20, Math.max(20, cursor[0])), Math.min(view.height - 20, Math.max(20, cursor[1]))];
    if (inside[0] === cursor[0] && inside[1] === cursor[1]) return;
    view.move(inside[0] - cursor[0], inside[1] - cursor[1]);
    cursor = inside;
    acts.changed();
  }
}
