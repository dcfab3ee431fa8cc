// Bundles src/ into one HTML file with holes for a title and the data. `--check` compares it with the committed one.

import { createHash } from "node:crypto";
import { readFile, writeFile } from "node:fs/promises";
import { build } from "esbuild";

const PAGE = new URL("../src/cruise/viewer/page.html", import.meta.url);
const LICENCE = new URL("../src/cruise/viewer/three-LICENSE.txt", import.meta.url);
const here = (path) => new URL(path, import.meta.url);
const text = (path) => readFile(here(path), "utf8");

async function bundle(entry, options = {}) {
  const { outputFiles } = await build({
    entryPoints: [new URL(entry, import.meta.url).pathname],
    bundle: true,
    minify: true,
    write: false,
    charset: "utf8",
    target: ["chrome111", "firefox114", "safari16.4"],
    legalComments: "none",
    ...options,
  });
  return outputFiles[0].text.trim();
}

async function makePage() {
  const licence = (await text("node_modules/three/LICENSE")).trim();
  const banner = `/*! Holds three.js.\n${licence}\n*/`;
  const script = inScript(await bundle("src/main.js", { format: "iife", banner: { js: banner } }));
  const style = `${colours(JSON.parse(await text("../src/cruise/palette.json")))}\n${await bundle("src/page.css")}`;
  const hash = createHash("sha256").update(script).digest("base64");
  // Nothing may be loaded from anywhere; a live page may listen to the server that it came from.
  const policy = [
    "default-src 'none'",
    `script-src 'sha256-${hash}'`,
    "style-src 'unsafe-inline'",
    "img-src data: blob:",
    "connect-src 'self'",
    "base-uri 'none'",
    "form-action 'none'",
  ].join("; ");
  const page = await text("src/page.html");
  return { page: fill(page, { policy, style, script }), licence: `${licence}\n` };
}

const GLASS = "d3"; // opacity of panels over the picture

/** Custom properties of both schemes, `--ink` and so on. */
function colours({ dark, light }) {
  const rule = (selector, { ui }) => {
    const all = Object.entries({ ...ui, glass: ui.panel + GLASS });
    return `${selector} { ${all.map(([name, value]) => `--${name}: ${value};`).join(" ")} }`;
  };
  return [rule(":root", dark), rule(':root[data-theme="light"]', light)].join("\n");
}

/** Text that does not end the script element it stands in. */
function inScript(script) {
  return script.replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--");
}

function fill(page, holes) {
  return page.replace(/\{\{(\w+)\}\}/g, (hole, name) => holes[name] ?? hole);
}

const { page, licence } = await makePage();
if (process.argv.includes("--check")) {
  const committed = await readFile(PAGE, "utf8").catch(() => "");
  if (page !== committed) {
    console.error("src/cruise/viewer/page.html is not what viewer/ builds: run make viewer and commit it");
    process.exit(1);
  }
} else {
  await writeFile(PAGE, page);
  await writeFile(LICENCE, licence);
  console.log(`src/cruise/viewer/page.html: ${Math.round(Buffer.byteLength(page) / 1000)} kB`);
}
