"""A headless Chromium, driven over the W3C WebDriver protocol: chromedriver and HTTP, no library."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

PATIENCE_S = 30.0
PROGRAMS = {"chromium": ("chromium", "chromium-browser", "google-chrome"), "driver": ("chromedriver",)}
SWITCHES = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-default-apps", "--enable-unsafe-swiftshader", "--enable-precise-memory-info",
    "--js-flags=--expose-gc", "--hide-scrollbars",
)  # fmt: skip


def program(kind):
    """The first of its programs that is installed; None without."""
    return next((found for name in PROGRAMS[kind] if (found := shutil.which(name))), None)


def is_installed():
    return all(program(kind) for kind in PROGRAMS)


class Browser:
    """One window.

    Parameters
    ----------
    size : tuple of int
        Width and height [px].
    ratio : float
        Device pixels a pixel.
    is_phone : bool
        Whether it says that it is a telephone with a touch screen.
    """

    def __init__(self, size=(1360, 850), ratio=1.0, *, is_phone=False, is_dark=False):
        self._folder = tempfile.mkdtemp(prefix="browser-")
        self._driver = subprocess.Popen(
            [program("driver"), "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        port = next(
            line.rstrip().rstrip(".").rpartition(" ")[2]
            for line in self._driver.stdout
            if "port" in line and "successfully" in line
        )
        self._base = f"http://127.0.0.1:{port}"
        options = {
            "binary": program("chromium"),
            "args": [*SWITCHES, f"--user-data-dir={self._folder}", f"--window-size={size[0]},{size[1]}"],
        }
        session = self._post(
            "/session",
            {
                "capabilities": {
                    "alwaysMatch": {
                        "goog:chromeOptions": options,
                        "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
                    }
                }
            },
        )
        self._base += f"/session/{session['sessionId']}"
        self._post("/timeouts", {"script": 120_000, "pageLoad": 60_000})
        self.cdp(
            "Emulation.setDeviceMetricsOverride",
            width=size[0], height=size[1], deviceScaleFactor=ratio, mobile=is_phone,
        )  # fmt: skip
        if is_phone:
            self.cdp("Emulation.setTouchEmulationEnabled", enabled=True)
        self.cdp(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": "dark" if is_dark else "light"}],
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        try:
            self._call("DELETE", "")
        finally:
            self._driver.terminate()
            self._driver.wait()
            self._driver.stdout.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            self._base + path, data, {"Content-Type": "application/json"}, method=method
        )
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(request, timeout=180.0) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            with error:
                raise AssertionError(json.load(error)["value"]["message"]) from None

    def _post(self, path, body):
        return self._call("POST", path, body)

    def cdp(self, command, **parameters):
        """A command of Chromium's own protocol."""
        return self._post("/goog/cdp/execute", {"cmd": command, "params": parameters})

    def open(self, url):
        self._post("/url", {"url": url})

    def run(self, script, *arguments):
        """What a function's body returns; a promise is awaited."""
        return self._post("/execute/sync", {"script": script, "args": list(arguments)})

    def until(self, script, *arguments, seconds=PATIENCE_S):
        """What an expression is as soon as it is true."""
        end = time.monotonic() + seconds
        while True:
            found = self.run(f"return {script}", *arguments)
            if found:
                return found
            if time.monotonic() > end:
                raise AssertionError(f"not within {seconds:.0f} s: {script}")

    def text(self, selector):
        return self.run("return document.querySelector(arguments[0]).innerText", selector)

    def click(self, selector):
        self.run("document.querySelector(arguments[0]).click()", selector)

    def press(self, key):
        self.run(
            "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0], bubbles: true}))",
            key,
        )

    def complaints(self):
        """What the console has said since it was last asked."""
        return [entry for entry in self._post("/se/log", {"type": "browser"}) if entry["level"] != "INFO"]

    def asked(self):
        """URLs that were asked for since it was last asked."""
        entries = [
            json.loads(entry["message"])["message"]
            for entry in self._post("/se/log", {"type": "performance"})
        ]
        return [
            entry["params"]["request"]["url"]
            for entry in entries
            if entry["method"] == "Network.requestWillBeSent"
        ]

    def picture(self, file):
        """Write what is seen as a PNG."""
        Path(file).write_bytes(base64.b64decode(self._call("GET", "/screenshot")))
