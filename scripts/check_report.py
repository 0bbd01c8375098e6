#!/usr/bin/env python3
"""Opens reports in headless Chromium without a network, as `make report` does.

Usage: scripts/check_report.py REPORT.html... [--pictures DIR]

Needs Debian's packages chromium and chromium-driver. For each page, at widths of 1280 and 390
pixels: the page is ready, the console has no error, nothing was requested from elsewhere, nothing
is wider than the window, two instants look different, and the keyboard moves the view. Once each:
dark mode, reduced motion (the page stands still), no JavaScript (the pictures are there), and paper
(a few pages, in PDF beside the pictures).
"""
import argparse
import base64
import json
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

FLAGS = [
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
]


class Browser:
    """Session of ChromeDriver, by the WebDriver protocol."""

    def __init__(self, profile):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.driver = subprocess.Popen(
            ["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.root = f"http://127.0.0.1:{port}"
        options = {
            "goog:chromeOptions": {"args": FLAGS + [f"--user-data-dir={profile}"]},
            "goog:loggingPrefs": {"browser": "ALL"},
        }
        for attempt in range(100):
            try:
                answer = self.call("POST", "/session", {"capabilities": {"alwaysMatch": options}})
                break
            except OSError:
                if attempt == 99:
                    raise
                time.sleep(0.2)
        self.root += f"/session/{answer['sessionId']}"

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.root + path, data, {"Content-Type": "application/json"}, method=method)
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(request, timeout=120) as answer:
            return json.load(answer)["value"]

    def devtools(self, command, **parameters):
        return self.call("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def run(self, script):
        return self.call("POST", "/execute/sync", {"script": script, "args": []})

    def open(self, address, width, height, features=()):
        self.devtools("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                      mobile=width < 500)
        features = [{"name": name, "value": value} for name, value in features]
        self.devtools("Emulation.setEmulatedMedia", media="", features=features)
        self.call("POST", "/url", {"url": "about:blank"})
        self.call("POST", "/url", {"url": address})

    def ready(self):
        for _ in range(150):
            if self.run("return document.documentElement.dataset.ready === 'yes'"):
                return True
            time.sleep(0.1)
        return False

    def picture(self, whole=False):
        return base64.b64decode(self.devtools("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"])

    def close(self):
        try:
            self.call("DELETE", "")
        finally:
            self.driver.terminate()
            self.driver.wait()


class Report:
    """Checks of one page, with the list of what fails."""

    def __init__(self, browser, path, pictures):
        self.browser, self.path, self.pictures, self.faults = browser, path, pictures, []
        self.address = path.resolve().as_uri()

    def holds(self, truth, what):
        if not truth:
            self.faults.append(f"{self.path}: {what}")

    def keep(self, name, bytes_of):
        if self.pictures:
            (self.pictures / f"{self.path.parent.name}-{name}.png").write_bytes(bytes_of)

    def at_width(self, width, height):
        browser = self.browser
        browser.open(self.address, width, height, [("prefers-reduced-motion", "reduce")])
        self.holds(browser.ready(), f"{width} px: not ready: " + str(browser.run(
            "return document.getElementById('trouble')?.textContent")))
        for entry in browser.call("POST", "/se/log", {"type": "browser"}):
            self.holds(entry["level"] not in ("SEVERE", "WARNING"), f"{width} px: console: {entry['message']}")
        asked = browser.run("return performance.getEntriesByType('resource').map((r) => r.name)"
                            ".filter((name) => !/^(data|blob):/.test(name))")
        self.holds(not asked, f"{width} px: requests {asked}")
        wide = browser.run("return document.documentElement.scrollWidth")
        self.holds(wide <= width, f"{width} px: the page is {wide} px wide")
        if browser.run("return !!document.getElementById('view')"):
            self.view(width)
        size = browser.run("return [document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
        browser.devtools("Emulation.setDeviceMetricsOverride", width=width, height=min(size[1], 6000),
                         deviceScaleFactor=1, mobile=width < 500)
        time.sleep(0.3)
        self.keep(f"{width}", browser.picture())

    def view(self, width):
        """Two instants differ in the picture, and so does the view after a key."""
        browser = self.browser
        browser.run("document.getElementById('view').scrollIntoView({block: 'center'})")
        shot = "const v = document.getElementById('view'); return v.toDataURL()"
        last = browser.run("return Number(document.getElementById('time').max)")
        moved = "const s = document.getElementById('time'); s.value = {}; s.dispatchEvent(new Event('input'))"
        seen, canvases = [], []
        for share in (0.02, 0.13) if last >= 20 else (0, 1):
            browser.run(moved.format(share * last))
            time.sleep(0.2)
            seen.append(browser.picture())
            canvases.append(browser.run(shot))
            self.keep(f"{width}-at-{share}", seen[-1])
        if last > 0:
            self.holds(seen[0] != seen[1], f"{width} px: two instants look alike")
            self.holds(canvases[0] != canvases[1], f"{width} px: the view does not move")
        key = "const v = document.getElementById('view'); v.focus(); " \
              "v.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft', bubbles: true})); return v.toDataURL()"
        self.holds(browser.run(key) != canvases[1], f"{width} px: an arrow key does not turn the view")
        painted = browser.run("const v = document.getElementById('view'), c = document.createElement('canvas');"
                              "c.width = v.width; c.height = v.height; const x = c.getContext('2d'); x.drawImage(v, 0, 0);"
                              "const p = x.getImageData(0, 0, c.width, c.height).data; const s = new Set();"
                              "for (let i = 0; i < p.length; i += 4) if (p[i + 3] > 200) s.add(p[i] * 65536 + p[i + 1] * 256 + p[i + 2]);"
                              "return s.size")
        self.holds(painted > 10, f"{width} px: the view has {painted} colours")

    def later(self, place):
        time.sleep(0.2)
        return self.browser.run(place) > 0

    def others(self):
        """Dark mode, motion, and a browser without JavaScript."""
        browser = self.browser
        browser.open(self.address, 1280, 900, [("prefers-color-scheme", "dark"), ("prefers-reduced-motion", "reduce")])
        browser.ready()
        dark = browser.run("return getComputedStyle(document.body).backgroundColor")
        self.holds(sum(int(part) for part in dark[4:-1].split(",")) < 200, f"dark mode is {dark}")
        place = "return Number(document.getElementById('time')?.value ?? 0)"
        first = browser.run(place)
        browser.devtools("Emulation.setDeviceMetricsOverride", width=1280, height=4000, deviceScaleFactor=1, mobile=False)
        time.sleep(0.5)
        self.keep("dark", browser.picture())
        self.holds(browser.run(place) == first, "moves although the user wants less motion")
        if browser.run("return Number(document.getElementById('time')?.max ?? 0) > 0"):
            browser.open(self.address, 1280, 900)
            browser.ready()
            self.holds(any(self.later(place) for _ in range(50)), "does not play by itself")
        paper = base64.b64decode(browser.devtools("Page.printToPDF", printBackground=True)["data"])
        pages = paper.count(b"/Type /Page\n")
        self.holds(1 <= pages <= 12, f"{pages} pages on paper")
        if self.pictures:
            (self.pictures / f"{self.path.parent.name}.pdf").write_bytes(paper)
        browser.devtools("Emulation.setScriptExecutionDisabled", value=True)
        browser.open(self.address, 1280, 3000)
        time.sleep(0.3)
        self.keep("noscript", browser.picture())
        browser.devtools("Emulation.setScriptExecutionDisabled", value=False)
        shown = browser.run("return [...document.querySelectorAll('.picture svg')].filter((s) => s.clientHeight > 50).length")
        self.holds(shown >= 2, f"without JavaScript: {shown} pictures")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("reports", nargs="+", type=pathlib.Path)
    parser.add_argument("--pictures", type=pathlib.Path)
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(profile)
        faults = []
        try:
            browser.devtools("Network.enable")
            browser.devtools("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0,
                             uploadThroughput=0)
            for path in arguments.reports:
                report = Report(browser, path, arguments.pictures)
                for width, height in ((1280, 900), (390, 844)):
                    report.at_width(width, height)
                report.others()
                faults += report.faults
        finally:
            browser.close()
    for fault in faults:
        print(fault, file=sys.stderr)
    if not faults:
        print(f"{len(arguments.reports)} reports open without a network, at 1280 and 390 pixels")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
