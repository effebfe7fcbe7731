// Reads the arrays of a page: the writer and the format are in reports/scene/codec.py.

/** Bytes of a deflated, base64 text. */
export async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * One array: columns behind one another, each of zigzag varints that are differences along the rows,
 * taken `order` times, in multiples of `unit`.
 */
export function unpack(bytes, { at, rows, columns, order, unit }) {
  const values = new Float32Array(rows * columns);
  let next = at;
  for (let column = 0; column < columns; column++) {
    let value = 0;
    let slope = 0;
    for (let row = 0; row < rows; row++) {
      let code = 0;
      let scale = 1;
      let byte;
      do {
        byte = bytes[next++];
        code += (byte & 127) * scale;
        scale *= 128;
      } while (byte > 127);
      const delta = code % 2 ? -(code + 1) / 2 : code / 2;
      if (order === 2) {
        slope += delta;
        value += slope;
      } else {
        value = order === 1 ? value + delta : delta;
      }
      values[row * columns + column] = value * unit;
    }
  }
  return values;
}
