// A light on the half sphere before the scene, seen from the camera: dragged or moved by keys.

const LOWEST = 0.08; // light along the picture's plane says nothing

export class Hemisphere {
  /** `changed` hears of every new direction: x right, y up, z toward the camera. */
  constructor(canvas, output, changed) {
    Object.assign(this, { canvas, output, changed, direction: [0.55, 0.5, 0.67] });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.at(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) this.at(event);
    });
    canvas.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 0.2 : 0.05;
      const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (event.key === "Home") this.set(0, 0);
      else if (moves[event.key]) this.nudge(...moves[event.key]);
      else return;
      event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
    this.set(this.direction[0], this.direction[1]);
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    const radius = box.width / 2;
    this.set((event.clientX - box.left) / radius - 1, 1 - (event.clientY - box.top) / radius);
  }

  nudge(x, y) {
    this.set(this.direction[0] + x, this.direction[1] + y);
  }

  /** From a place on the disk, which is the half sphere seen from the camera. */
  set(x, y) {
    const most = Math.sqrt(1 - LOWEST * LOWEST);
    const length = Math.hypot(x, y);
    if (length > most) [x, y] = [(x / length) * most, (y / length) * most];
    this.direction = [x, y, Math.sqrt(1 - x * x - y * y)];
    const words = this.direction.map((value) => value.toFixed(2)).join(", ");
    this.output.textContent = words;
    this.canvas.setAttribute("aria-valuetext", `x ${words.replaceAll(", ", " ")}`);
    this.changed();
    // Pointers move more often than the screen shows.
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = undefined;
      this.draw();
    });
  }

  draw() {
    const scale = devicePixelRatio || 1;
    const size = Math.round(this.canvas.clientWidth * scale);
    if (!size) return;
    if (this.canvas.width !== size) this.canvas.width = this.canvas.height = size;
    const pen = this.canvas.getContext("2d");
    const r = size / 2;
    pen.clearRect(0, 0, size, size);
    const [x, y] = this.direction;
    const [lx, ly] = [r + x * r * 0.94, r - y * r * 0.94];
    const ball = pen.createRadialGradient(lx, ly, r * 0.05, lx, ly, r * 1.9);
    ball.addColorStop(0, "#8b8471");
    ball.addColorStop(0.45, "#3a3b44");
    ball.addColorStop(1, "#191a20");
    pen.fillStyle = ball;
    pen.beginPath();
    pen.arc(r, r, r * 0.97, 0, 7);
    pen.fill();
    pen.strokeStyle = "#ffffff22";
    pen.lineWidth = scale;
    for (const elevation of [30, 60]) {
      pen.beginPath();
      pen.arc(r, r, r * 0.97 * Math.cos((elevation * Math.PI) / 180), 0, 7);
      pen.stroke();
    }
    pen.beginPath();
    pen.moveTo(r, r * 0.03);
    pen.lineTo(r, r * 1.97);
    pen.moveTo(r * 0.03, r);
    pen.lineTo(r * 1.97, r);
    pen.stroke();
    pen.fillStyle = "#f2b75c";
    pen.beginPath();
    pen.arc(lx, ly, 8 * scale, 0, 7);
    pen.fill();
    pen.strokeStyle = "#f2b75c55";
    pen.lineWidth = 5 * scale;
    pen.stroke();
  }
}
