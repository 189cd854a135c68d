// The large picture: what is shown, and what it is compared with on the other side of a divider.

export class Picture {
  constructor(canvas, overlay, divider, tags) {
    Object.assign(this, { canvas, overlay, divider, tags, before: null, after: null, share: 0.5 });
    this.pen = canvas.getContext("2d", { alpha: false });
    const move = (event) => {
      const box = canvas.getBoundingClientRect();
      this.part((event.clientX - box.left) / box.width);
    };
    divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
    divider.addEventListener("pointermove", (event) => {
      if (divider.hasPointerCapture(event.pointerId)) move(event);
    });
    divider.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      this.part(this.share + step);
    });
    new ResizeObserver(() => this.place()).observe(canvas);
  }

  part(share) {
    this.share = Math.min(1, Math.max(0, share));
    this.divider.setAttribute("aria-valuenow", Math.round(100 * this.share));
    this.place();
    this.draw();
  }

  /** The divider and its words follow the picture, which its frame may be wider than. */
  place() {
    const box = this.canvas.getBoundingClientRect();
    const frame = this.canvas.parentElement.getBoundingClientRect();
    this.divider.style.left = `${box.left - frame.left + this.share * box.width}px`;
    const [before, after] = this.tags;
    before.style.left = `calc(${box.left - frame.left}px + 0.6rem)`;
    after.style.right = `calc(${frame.right - box.right}px + 0.6rem)`;
  }

  show(after) {
    this.after = after;
    this.draw();
  }

  /** Something to compare with; nothing without a picture. */
  compare(before) {
    this.before = before;
    for (const part of [this.divider, ...this.tags]) part.hidden = !before;
    this.place();
    this.draw();
  }

  draw() {
    const { after, before, canvas, pen } = this;
    if (!after) return;
    if (canvas.width !== after.width || canvas.height !== after.height) {
      canvas.width = after.width;
      canvas.height = after.height;
      canvas.parentElement.style.setProperty("--ratio", after.width / after.height);
      this.place();
    }
    if (after instanceof ImageData) pen.putImageData(after, 0, 0);
    else pen.drawImage(after, 0, 0);
    const part = Math.round(this.share * after.width);
    if (before && before.width === after.width && part) {
      pen.drawImage(before, 0, 0, part, after.height, 0, 0, part, after.height);
    }
  }

  /** Marks the pixels of an image for which a rule holds on a sheet above the picture. */
  mark(image, rule) {
    const { overlay } = this;
    if (!image) {
      overlay.width = 0;
      return;
    }
    const { width, height, data } = image;
    overlay.width = width;
    overlay.height = height;
    const sheet = new ImageData(width, height);
    const ink = new Uint32Array(sheet.data.buffer);
    for (let i = 0; i < ink.length; i++) {
      const stripe = ((i % width) + Math.floor(i / width)) & 4;
      if (stripe && rule(data, 4 * i)) ink[i] = 0xff3030ff;
    }
    overlay.getContext("2d").putImageData(sheet, 0, 0);
  }
}
