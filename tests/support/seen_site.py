"""Pages of the built site in a browser, at the sizes of a phone and a desktop, light and dark.

`python -m tests.support.seen_site SITE FOLDER [PAGE ...]` writes pictures of pages to look at, by default of all.

It needs the same programs as `browser.py`. Pages are local files, and need no network.
"""

from __future__ import annotations

import base64
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.support import browser

#: (width, height) in CSS pixels, by device.
SCREENS = {"phone": (390, 844), "desk": (1440, 900)}
THEMES = ("light", "dark")

#: Elements that extend beyond the right edge of the window and are not in a scrolling box: (tag, class,
#: right edge).
_WIDER = """
const found = [], width = document.documentElement.clientWidth
const scrolls = node => {
  for (let each = node.parentElement; each && each !== document.body; each = each.parentElement)
    if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(each).overflowX)) return true
  return false
}
for (const each of document.querySelectorAll('article *')) {
  const right = each.getBoundingClientRect().right
  if (right > width + 1 && !scrolls(each)) found.push([each.tagName, each.className, Math.round(right)])
}
const root = document.documentElement
if (root.scrollWidth > width) found.push(['HTML', 'scrollWidth', root.scrollWidth])
return found.slice(0, 5)
"""

#: Pictures of the page that have no alternative text, or have not loaded.
_WITHOUT_TEXT = """
return [...document.querySelectorAll('article img')]
  .filter(each => !each.alt.trim() || (each.complete && !each.naturalWidth))
  .map(each => `${each.src.slice(0, 80)} alt=${each.alt}`)
"""

#: Texts whose contrast with the background is below 3, the minimum for large text (WCAG 2.2, 1.4.3).
_FAINT = """
const numbers = text => (text.match(/[\\d.]+/g) || []).map(Number)
const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
  .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
  .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0)
const behind = node => {
  for (let each = node; each; each = each.parentElement) {
    const colour = numbers(getComputedStyle(each).backgroundColor)
    if (colour.length === 3 || colour[3] > 0.5) return colour
  }
  return [255, 255, 255]
}
const found = new Set()
const words = ['p', 'li', 'td', 'th', 'code', 'pre span'].map(each => `article ${each}`).join()
for (const each of document.querySelectorAll(words)) {
  if (!each.textContent.trim() || !each.getClientRects().length) continue
  const [a, b] = [light(numbers(getComputedStyle(each).color)), light(behind(each))]
  const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)
  if (contrast < 3) found.add(`${each.tagName}.${each.className}: ${contrast.toFixed(1)}`)
}
return [...found].slice(0, 5)
"""


class Site:
    """A browser with one page of the site in it.

    folder : folder of the built site
    """

    def __init__(self, driver: Any, folder: Path) -> None:
        self.driver, self.folder = driver, folder

    def look(self, page: str, screen: str, theme: str) -> None:
        """Load a page at the size of a screen of `SCREENS`."""
        width, height = SCREENS[screen]
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": screen == "phone"}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        self.set_theme(theme)
        self.driver.get((self.folder / page).resolve().as_uri())
        # Pictures below the window would load only after scrolling to them.
        self.driver.execute_script("document.querySelectorAll('img').forEach(each => { each.loading = 'eager' })")

    def set_theme(self, theme: str) -> None:
        """Set the colour scheme that the reader's system prefers."""
        media = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)

    def wider(self) -> list[list[Any]]:
        """Return the elements that are wider than the window and not in a scrolling box."""
        found: list[list[Any]] = self.driver.execute_script(_WIDER)
        return found

    def without_text(self) -> list[str]:
        """Return the pictures that have no alternative text, or have not loaded."""
        found: list[str] = self.driver.execute_script(_WITHOUT_TEXT)
        return found

    def faint(self) -> list[str]:
        """Return the texts that have little contrast with their background."""
        found: list[str] = self.driver.execute_script(_FAINT)
        return found

    def picture(self) -> bytes:
        """Return the page as PNG, down to 4000 pixels."""
        size = self.driver.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": min(size["height"], 4000), "scale": 1}
        shot = self.driver.execute_cdp_cmd("Page.captureScreenshot", {"clip": clip, "captureBeyondViewport": True})
        return base64.b64decode(shot["data"])


def pages(folder: Path) -> Iterator[str]:
    """Yield all pages with content, without the search and the index of names."""
    for path in sorted(folder.rglob("*.html")):
        if path.name not in ("genindex.html", "search.html", "py-modindex.html"):
            yield path.relative_to(folder).as_posix()


if __name__ == "__main__":
    site_folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    with browser.chrome() as chrome:
        site = Site(chrome, site_folder)
        for name in sys.argv[3:] or list(pages(site_folder)):
            for screen in SCREENS:
                for theme in THEMES:
                    site.look(name, screen, theme)
                    stem = f"{name.removesuffix('.html').replace('/', '-')}-{screen}-{theme}"
                    (out / f"{stem}.png").write_bytes(site.picture())
                    print(stem, site.wider(), site.without_text(), site.faint())
