"""Checks reports in Chromium.

    python3 tests/report/check.py PINC WORK [REPORT...]

PINC is the program, WORK a directory for files, REPORT one of RUNS; all of them without. `.ci/report`
installs Chromium and Poppler and runs this. Findings are printed and make it fail; pictures of screen,
print and pages without scripts are left in WORK.
"""

import html
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

PINC, WORK = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
HERE = Path(__file__).resolve().parent
CONFIGS = HERE.parents[1] / "configs"
MOST = 2_000_000  # bytes of a page
FAILED = []

# What each report is made from: a run with everything, the same with another seed, one of 1e5 rows, an
# estimator, a sweep with curves, and accuracy over cost.
RUNS = {
    "run": ["run", CONFIGS / "smoke/van-der-pol.toml"],
    "other": ["run", CONFIGS / "smoke/van-der-pol.toml", "--set", "seed=8"],
    "long": ["control", CONFIGS / "estimation/tanks.toml", "--only", "rk4",
             "--set", "control.duration_s=112000.0", "--set", "control.repetitions=1"],
    "estimates": ["control", CONFIGS / "estimation/tanks.toml", "--only", "rk4"],
    "curves": ["run", HERE / "curves.toml"],
    "cost": ["run", HERE / "cost.toml"],
}


def failed(what):
    FAILED.append(what)
    print(f"FAILED: {what}")


def pinc(*arguments):
    subprocess.run([PINC, *map(str, arguments), "--quiet"], check=True)


def chromium(page, *arguments):
    """Opens a page; returns what Chromium writes."""
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               "--window-size=1200,900", "--no-first-run",
               "--disable-background-networking", "--disable-component-update",
               # Nothing goes out, whoever asks.
               "--host-resolver-rules=MAP * ~NOTFOUND",
               f"--user-data-dir={WORK / 'profile'}"]
    command = ["chromium", *options, *map(str, arguments), page.as_uri()]
    return subprocess.run(command, check=True, text=True, capture_output=True, timeout=300).stdout


def requests(log):
    """The addresses that a page asked for, by a log of Chromium's network; what Chromium itself wants
    has no origin."""
    events = [event.get("params", {}) for event in json.loads(log.read_text())["events"]]
    asked = {event["url"] for event in events if event.get("initiator", "not an origin") != "not an origin"}
    return sorted(url for url in asked if not url.startswith(("file:", "data:")))


def seen():
    """A request is seen where there is one."""
    page, log = WORK / "loads.html", WORK / "loads-net.json"
    page.write_text("<!DOCTYPE html><body><img src='http://elsewhere.invalid/a.png'></body>")
    chromium(page, "--virtual-time-budget=5000", f"--log-net-log={log}", "--dump-dom")
    if requests(log) != ["http://elsewhere.invalid/a.png"]:
        failed(f"a page that loads a picture asks for {requests(log)}")


def tried(name, page):
    """The page with a reader's actions, and what they found."""
    with_script = WORK / f"{name}-tried.html"
    script = f"<script>\n{(HERE / 'check.js').read_text()}</script>\n</body>"
    with_script.write_text(page.read_text().replace("</body>", script))
    log = WORK / f"{name}-net.json"
    budget = "--virtual-time-budget=400000"
    dom = chromium(with_script, budget, f"--log-net-log={log}", "--dump-dom")
    found = re.search(r'<pre id="checked">(.*?)</pre>', dom, re.S)
    if not found:
        return failed(f"{name}: the page's check did not end")
    result = json.loads(html.unescape(found[1]))
    print(f"{name}: {result['facts']}")
    for finding in result["findings"]:
        failed(f"{name}: {finding}")
    if not result["facts"]["figures"]:
        failed(f"{name}: no picture can be zoomed")
    loaded = requests(log)
    if loaded:
        failed(f"{name}: requests to {loaded}")


def static(name, page):
    """In print and without scripts the page shows the SVG pictures."""
    plain = WORK / f"{name}-plain.html"
    text = re.sub(r"<script\b.*?</script>\n", "", page.read_text(), flags=re.S)
    plain.write_text(text)
    prints = []
    for source in [page, plain]:
        pdf = WORK / f"{source.stem}.pdf"
        chromium(source, "--virtual-time-budget=5000", "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
        subprocess.run(["pdftoppm", "-r", "60", "-png", pdf, pdf.with_suffix("")], check=True)
        prints.append([path.read_bytes() for path in sorted(WORK.glob(f"{source.stem}-[0-9]*.png"))])
    if prints[0] != prints[1] or not prints[0]:
        failed(f"{name}: its {len(prints[0])} printed pages do not show its SVG pictures")
    size = "--window-size=1200,6000"
    chromium(page, size, "--virtual-time-budget=5000", f"--screenshot={WORK / f'{name}-screen.png'}")
    silent = WORK / f"{name}-no-scripts.html"
    silent.write_text(page.read_text().replace("script-src 'unsafe-inline'", "script-src 'none'"))
    chromium(silent, size, f"--screenshot={WORK / f'{name}-no-scripts.png'}")
    chromium(plain, size, f"--screenshot={WORK / f'{name}-plain.png'}")
    pictures = [(WORK / f"{name}-{kind}.png").read_bytes() for kind in ["no-scripts", "plain"]]
    if pictures[0] != pictures[1]:
        failed(f"{name}: the page without scripts does not show its SVG pictures")


def main():
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    seen()
    names = sys.argv[3:] or [*RUNS, "compared"]
    for name in names:
        out, page = WORK / name, WORK / f"{name}.html"
        if name == "compared":
            pinc("compare", WORK / "run", WORK / "other", "--out", page)
        else:
            pinc(*RUNS[name], "--out", out)
            shutil.copy(out / "report.html", page)
        size = page.stat().st_size
        print(f"{name}: {size} bytes")
        if size > MOST:
            failed(f"{name}: {size} bytes")
        tried(name, page)
        static(name, page)
    print(f"{len(FAILED)} failed")
    sys.exit(bool(FAILED))


main()
