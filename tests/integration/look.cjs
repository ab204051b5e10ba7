// Opens pages in the system's Chromium: node look.cjs '[{"url", "text", "file", "click"}]'; prints what it saw as JSON.
// `text` must become visible; `file` gets a picture; `click` is a text to click first.
const { chromium } = require("playwright-core");

(async () => {
  const pages = JSON.parse(process.argv[2]);
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox"] });
  const seen = [];
  try {
    for (const { url, text, file, click } of pages) {
      const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
      const outside = [];
      const errors = [];
      page.on("request", (request) => { const { hostname, protocol } = new URL(request.url()); if (protocol.startsWith("http") && hostname !== "127.0.0.1") outside.push(request.url()); });
      page.on("console", (message) => { if (message.type() === "error") errors.push(message.text()); });
      page.on("pageerror", (error) => errors.push(String(error)));
      let found = true;
      try {
        await page.goto(url, { waitUntil: "load", timeout: 45000 });
        if (click) await page.getByText(click, { exact: true }).first().click({ timeout: 30000 });
        await page.getByText(text).first().waitFor({ timeout: 30000 });
        await page.waitForTimeout(1500);
      } catch (error) {
        found = false;
        errors.push(String(error));
      }
      const broken = await page.evaluate(() => [...document.images].filter((image) => image.complete && !image.naturalWidth).map((image) => image.src));
      const pictures = await page.evaluate(() => [...document.images].filter((image) => image.naturalWidth).length);
      await page.screenshot({ path: file });
      seen.push({ url, found, outside, errors, broken, pictures });
      await page.close();
    }
  } finally {
    await browser.close();
  }
  console.log(JSON.stringify(seen));
})();
