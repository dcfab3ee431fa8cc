// The colour scale of speeds: matplotlib's viridis at nine places, dark to bright.

const STOPS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];

/** RGBA of the stops, a byte each. */
export function viridisBytes() {
  return Uint8Array.from(
    STOPS.flatMap((hex) => [1, 3, 5, 0].map((at) => (at ? parseInt(hex.slice(at, at + 2), 16) : 255))),
  );
}

/** The part of the scale from `low` to `high` (of 1) as a CSS gradient. */
export function viridisGradient([low, high]) {
  const last = STOPS.length - 1;
  const stops = STOPS.map((hex, k) => `${hex} ${(100 * (k / last - low)) / (high - low)}%`);
  return `linear-gradient(to right, ${stops.join(", ")})`;
}
