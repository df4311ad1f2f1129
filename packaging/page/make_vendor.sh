#!/usr/bin/env bash
# Makes companion/ui/page/static/vendor anew, from the packages that package-lock.json names. Needs node and npm;
# what it makes is kept in the source, so that nothing else does.
set -euo pipefail
cd "$(dirname "$0")"
vendor=../../companion/ui/page/static/vendor
npm ci --ignore-scripts --no-audit --no-fund
mkdir -p "$vendor"
npx --no-install esbuild uplot.js --bundle --format=esm --minify --legal-comments=none --outfile="$vendor/uplot.js"
npx --no-install esbuild three_parts.js --bundle --format=esm --minify --legal-comments=none --outfile="$vendor/three.js"
cp node_modules/uplot/dist/uPlot.min.css "$vendor/uPlot.min.css"
cp node_modules/uplot/LICENSE "$vendor/uPlot-LICENSE.txt"
cp node_modules/three/LICENSE "$vendor/three-LICENSE.txt"
rm -rf node_modules
