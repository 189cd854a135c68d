// What the camera sees now: picture after picture, its histogram, and what is clipped.

import { preview } from "./api.js";

const CLIPPED = 254; // the alpha by which the daemon marks a clipped pixel

export const isClipped = (data, at) => data[at + 3] === CLIPPED;

/** Shows previews of a device until `stop()`; `show` gets each, `failed` why there are none. */
export function look(device, show, failed) {
  let on = true;
  (async () => {
    let after = 0;
    while (on) {
      try {
        const { image, number } = await preview(device, after);
        if (!on) return;
        after = number;
        show(image);
        await new Promise(requestAnimationFrame);
      } catch (error) {
        if (!on) return;
        failed(error);
        await new Promise((wake) => setTimeout(wake, 1000));
      }
    }
  })();
  return () => { on = false; };
}

/** Draws how many pixels have which value, per color; returns the clipped share. */
export function histogram(canvas, image) {
  const bins = [0, 1, 2].map(() => new Uint32Array(128));
  let clipped = 0;
  const { data } = image;
  for (let at = 0; at < data.length; at += 4) {
    for (let c = 0; c < 3; c++) bins[c][data[at + c] >> 1]++;
    if (isClipped(data, at)) clipped++;
  }
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  // The tallest few bins of a flat wall would hide all others.
  const all = bins.flatMap((bin) => [...bin]).sort((a, b) => b - a);
  const top = Math.max(1, all[6]);
  pen.globalCompositeOperation = "lighter";
  ["#e0504a", "#4fbf68", "#4f7fe6"].forEach((color, c) => {
    pen.fillStyle = color;
    bins[c].forEach((count, bin) => {
      const tall = Math.min(1, count / top) * (height - 4);
      pen.fillRect((bin * width) / 128, height - tall, width / 128, tall);
    });
  });
  pen.globalCompositeOperation = "source-over";
  return clipped / (data.length / 4);
}
