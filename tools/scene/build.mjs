// Builds reports/scene/replay.js from reports/scene/src, with what it uses of three.js: `make bundle`.
// esbuild is deterministic at a fixed version, so that equal sources give equal bytes.
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const scene = join(here, "..", "..", "reports", "scene");
const sources = join(scene, "src");

// tests compare this with the sources, so that a bundle that was not built anew is noticed without npm
const hash = createHash("sha256");
for (const name of readdirSync(sources).sort()) hash.update(readFileSync(join(sources, name)));
const version = JSON.parse(readFileSync(join(here, "node_modules", "three", "package.json"))).version;

await build({
  entryPoints: [join(sources, "main.js")],
  outfile: join(scene, "replay.js"),
  nodePaths: [join(here, "node_modules")],
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  banner: { js: `/* three.js ${version}, MIT: see three.LICENSE. Sources: sha256 ${hash.digest("hex")} */` },
});
copyFileSync(join(here, "node_modules", "three", "LICENSE"), join(scene, "three.LICENSE"));
