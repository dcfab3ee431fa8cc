// Samples of one drone, packed by src/cruise/viewer/samples.py.

const STEPS = [1e-4, ...Array(6).fill(1e-3), ...Array(4).fill(2 ** -15)];

/** Columns of a packed flight: time, position (3), velocity (3), quaternion (4: w, x, y, z). */
export async function unpackSamples({ count, data }) {
  const planes = await inflate(Uint8Array.from(atob(data), (c) => c.charCodeAt(0)));
  if (planes.length !== count * 4 * STEPS.length) throw new Error("the samples of a drone are damaged");
  return STEPS.map((step, column) => unpackColumn(planes.subarray(column * 4 * count, (column + 1) * 4 * count), step));
}

function unpackColumn(planes, step) {
  const count = planes.length / 4;
  const values = new Float64Array(count);
  let sum = 0;
  for (let k = 0; k < count; k++) {
    const zigzag = planes[k] | (planes[count + k] << 8) | (planes[2 * count + k] << 16) | (planes[3 * count + k] << 24);
    sum += (zigzag >>> 1) ^ -(zigzag & 1);
    values[k] = sum * step;
  }
  return values;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
