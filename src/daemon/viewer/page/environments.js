// Light from all around: maps of a few skies, computed here, or one of the viewer's own.

const ROWS = 32; // finer than the 256 directions that the daemon tells apart

/** A map is a function of a direction (x right, y up, z toward the camera) to red, green, blue. */
const glow = ([x, y, z], toward, sharpness, color) => {
  const length = Math.hypot(...toward);
  const cosine = (x * toward[0] + y * toward[1] + z * toward[2]) / length;
  const amount = cosine > 0 ? cosine ** sharpness : 0;
  return color.map((value) => value * amount);
};
const sum = (...lights) => [0, 1, 2].map((c) => lights.reduce((total, light) => total + light[c], 0));

export const SKIES = {
  "Clear day": (d) => {
    const up = Math.max(d[1], 0);
    const sky = [0.25, 0.42, 0.8].map((v) => v * (0.5 + 0.7 * up));
    const ground = [0.16, 0.13, 0.1];
    return sum(d[1] > 0 ? sky : ground, glow(d, [0.5, 0.75, 0.45], 300, [90, 80, 64]));
  },
  Overcast: (d) => [0.7, 0.73, 0.78].map((v) => (v * (1 + 2 * Math.max(d[1], 0))) / 2),
  Sunset: (d) => sum(
    [0.13, 0.1, 0.2].map((v) => v * (1 + Math.max(d[1], 0))),
    glow(d, [-1, 0.12, 0.5], 5, [1.4, 0.55, 0.16]),
    glow(d, [-1, 0.12, 0.5], 400, [90, 40, 10]),
  ),
  Window: (d) => sum([0.05, 0.055, 0.07], glow(d, [-1, 0.35, 0.5], 12, [4.2, 4.4, 4.8])),
  Studio: (d) => sum(
    [0.05, 0.05, 0.05],
    glow(d, [-0.8, 0.5, 0.7], 20, [5, 4.6, 4]),
    glow(d, [0.9, 0.25, 0.6], 26, [1.4, 1.8, 2.6]),
    glow(d, [0, 0.98, 0.1], 30, [2, 2, 2.2]),
  ),
  Neon: (d) => sum(
    [0.02, 0.02, 0.04],
    glow(d, [-1, 0, 0.35], 18, [4.5, 0.2, 2.6]),
    glow(d, [1, 0.1, 0.35], 18, [0.1, 2.4, 4.2]),
  ),
};

/** The lights of a map that is turned by so many degrees; each has its share of the sphere. */
export function lightsOf(sky, degrees) {
  const turn = (degrees * Math.PI) / 180;
  const lights = [];
  for (let row = 0; row < ROWS; row++) {
    const latitude = Math.PI * (0.5 - (row + 0.5) / ROWS);
    const columns = Math.max(1, Math.round(2 * ROWS * Math.cos(latitude) / 2));
    const share = (Math.cos(latitude) * 2 * Math.PI ** 2) / (ROWS * columns) / Math.PI;
    for (let column = 0; column < columns; column++) {
      const longitude = 2 * Math.PI * ((column + 0.5) / columns - 0.5);
      const at = (angle) => [
        Math.cos(latitude) * Math.sin(angle), Math.sin(latitude), Math.cos(latitude) * Math.cos(angle),
      ];
      const direction = at(longitude);
      if (direction[2] < -0.3) continue; // behind the scene: lights nothing
      const intensity = sky(at(longitude - turn)).map((value) => value * share);
      if (intensity.some((value) => value > 1e-5)) {
        lights.push({
          direction: direction.map((value) => Number(value.toFixed(4))),
          intensity: intensity.map((value) => Number(value.toPrecision(4))),
        });
      }
    }
  }
  return lights;
}

/** Reads a Radiance picture (.hdr, RGBE): its middle is what lies before the camera's back. */
export function readHdr(buffer) {
  const bytes = new Uint8Array(buffer);
  const wrong = (what) => new Error(`this is no .hdr map: ${what}`);
  let at = 0;
  const line = () => {
    const end = bytes.indexOf(10, at);
    if (end < 0 || end - at > 1000) throw wrong("its header does not end");
    const text = new TextDecoder().decode(bytes.subarray(at, end));
    at = end + 1;
    return text;
  };
  if (!line().startsWith("#?")) throw wrong("it does not begin with #?");
  while (line() !== "");
  const [, height, width] = (line().match(/^-Y (\d+) \+X (\d+)$/) ?? []).map(Number);
  if (!height || width !== 2 * height || height > 4096) throw wrong("it must be twice as wide as high, at most 8192 × 4096");
  const pixels = new Float32Array(width * height * 3);
  const row = new Uint8Array(width * 4);
  for (let y = 0; y < height; y++) {
    if (bytes[at] === 2 && bytes[at + 1] === 2 && (bytes[at + 2] << 8) + bytes[at + 3] === width) {
      at += 4;
      for (let channel = 0; channel < 4; channel++) {
        for (let x = 0; x < width;) {
          let count = bytes[at++];
          const run = count > 128;
          if (run) count -= 128;
          if (!count || x + count > width) throw wrong("a row is damaged");
          for (let i = 0; i < count; i++) row[4 * x++ + channel] = run ? bytes[at] : bytes[at++];
          if (run) at++;
        }
      }
    } else {
      row.set(bytes.subarray(at, at + 4 * width));
      at += 4 * width;
    }
    if (at > bytes.length) throw wrong("it is cut");
    for (let x = 0; x < width; x++) {
      const scale = row[4 * x + 3] ? 2 ** (row[4 * x + 3] - 136) : 0;
      for (let c = 0; c < 3; c++) pixels[3 * (y * width + x) + c] = row[4 * x + c] * scale;
    }
  }
  // Means over the cells that are sent, so that no small lamp falls between them.
  const cells = new Float32Array(2 * ROWS * ROWS * 3);
  const counts = new Uint32Array(2 * ROWS * ROWS);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const cell = Math.floor((y * ROWS) / height) * 2 * ROWS + Math.floor((x * 2 * ROWS) / width);
      counts[cell]++;
      for (let c = 0; c < 3; c++) cells[3 * cell + c] += pixels[3 * (y * width + x) + c];
    }
  }
  return ([x, y, z]) => {
    const u = Math.min(2 * ROWS - 1, Math.floor((Math.atan2(x, -z) / (2 * Math.PI) + 0.5) * 2 * ROWS));
    const v = Math.min(ROWS - 1, Math.floor((0.5 - Math.asin(Math.max(-1, Math.min(1, y))) / Math.PI) * ROWS));
    const cell = v * 2 * ROWS + Math.max(0, u);
    return [0, 1, 2].map((c) => cells[3 * cell + c] / Math.max(1, counts[cell]));
  };
}
