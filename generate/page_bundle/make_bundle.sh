#!/usr/bin/env bash
# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
# Makes epson_driver/pages/assets/bundle.js and bundle.css of three.js, uPlot and their licences. Needs npm; users of the
# report do not: the result is committed.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
assets="$here/../../epson_driver/pages/assets"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cp "$here/package.json" "$here/package-lock.json" "$here/entry.js" "$work"
cd "$work"
npm ci --silent --no-audit --no-fund
npx --no-install esbuild entry.js --bundle --minify --format=iife --global-name=lib --target=es2020 \
  --legal-comments=none --outfile=bundle.js --log-level=warning
{
  echo '/*! three.js 0.187.0 (MIT) and uPlot 1.6.32 (MIT): licences in bundle.LICENSES.txt; made by generate/page_bundle */'
  cat bundle.js
} > "$assets/bundle.js"
{
  echo '/*! uPlot 1.6.32 (MIT): licence in bundle.LICENSES.txt */'
  cat node_modules/uplot/dist/uPlot.min.css
} > "$assets/bundle.css"
{
  echo 'bundle.js and bundle.css contain parts of these, unchanged but for the size:'
  echo; echo '=== three.js 0.187.0 ==='; echo; cat node_modules/three/LICENSE
  echo; echo '=== uPlot 1.6.32 ==='; echo; cat node_modules/uplot/LICENSE
} > "$assets/bundle.LICENSES.txt"
ls -l "$assets"
