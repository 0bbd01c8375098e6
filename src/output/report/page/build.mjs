// Makes bundle.js and bundle.css, which the program embeds, from the files of this folder and uPlot.
// Usage: npm ci && npm run build

import { build } from "esbuild";
import { readFileSync, writeFileSync } from "node:fs";

const version = (name) => JSON.parse(readFileSync(`node_modules/${name}/package.json`)).version;
const licence = readFileSync("node_modules/uplot/LICENSE", "utf8").trim();
writeFileSync("LICENSE-uPlot", `${licence}\n`);
const banner = `/* rebond, MIT or Apache-2.0. Contains uPlot ${version("uplot")}:\n${licence} */`;

await build({
  entryPoints: { bundle: "main.js" },
  outdir: ".",
  bundle: true,
  minify: true,
  format: "iife",
  target: ["chrome111", "firefox113", "safari16.4"],
  banner: { js: banner },
  charset: "utf8",
  legalComments: "none",
});
