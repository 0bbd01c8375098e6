// The numbers of the page: one gzip stream in base64, and the decoded arrays by name.

const SIZES = { f64: 8, f32: 4, u32: 4, levels: 2 };
const ARRAYS = { f64: Float64Array, f32: Float32Array, u32: Uint32Array, levels: Uint16Array };

/** Decodes all arrays that `list` describes. */
export async function decode(base64, list) {
  const packed = Uint8Array.from(atob(base64.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const arrays = {};
  let at = 0;
  for (const { name, kind, count, frames, low, quantum } of list) {
    const size = SIZES[kind];
    const values = new ARRAYS[kind](gathered(bytes, at, size, count));
    at += size * count;
    arrays[name] = kind === "levels" ? levels(values, frames, low, quantum) : values;
  }
  return arrays;
}

/** Puts the bytes of each number together; the stream has all first bytes, then all second ones. */
function gathered(bytes, at, size, count) {
  const out = new Uint8Array(size * count);
  for (let byte = 0; byte < size; byte++)
    for (let i = 0; i < count; i++) out[i * size + byte] = bytes[at + byte * count + i];
  return out.buffer;
}

/** Adds up the differences to the point before and to the frame before; level 0 is "no value". */
function levels(residuals, frames, low, quantum) {
  const points = residuals.length / frames;
  for (let f = 0, i = 0; f < frames; f++) {
    for (let p = 0; p < points; p++, i++) {
      const zigzag = residuals[i];
      const residual = (zigzag >>> 1) ^ -(zigzag & 1);
      const left = p > 0 ? residuals[i - 1] : 0;
      const before = f > 0 ? residuals[i - points] : 0;
      const corner = f > 0 && p > 0 ? residuals[i - points - 1] : 0;
      residuals[i] = residual + left + before - corner; // modulo 65536
    }
  }
  const value = (level) => (level === 0 ? NaN : low + (level - 1) * quantum);
  return {
    frames,
    /** Writes the values between two frames, or those of the only frame, into `out`. */
    at(place, out) {
      const last = frames - 1;
      const frame = Math.max(0, Math.min(Math.floor(place), last));
      const share = Math.max(0, Math.min(place - frame, 1));
      const a = frame * points, b = Math.min(frame + 1, last) * points;
      for (let p = 0; p < points; p++) {
        const from = value(residuals[a + p]);
        out[p] = share === 0 ? from : from + share * (value(residuals[b + p]) - from);
      }
      return out;
    },
    range() {
      let least = Infinity, most = -Infinity;
      for (const level of residuals)
        if (level !== 0) { least = Math.min(least, level); most = Math.max(most, level); }
      return least <= most ? [value(least), value(most)] : [NaN, NaN];
    },
  };
}
