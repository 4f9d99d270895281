"""The report's page in a real browser, without a network: no error, every 3-D view drawn."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.pairs import Pair
from gcl_core.evaluation.cases import case, worst
from gcl_core.evaluation.figures.result import new_figure
from gcl_core.evaluation.page import Drawing, page
from gcl_core.evaluation.plots import recall_over_distance, svg
from gcl_core.evaluation.predict import Prediction
from gcl_core.evaluation.published import published
from gcl_core.evaluation.score import score
from gcl_core.evaluation.tables import recall
from gcl_core.types import PointCloud

BROWSER = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser'))), None)


class Still:
    """Implements `Sequence`: the same wall from everywhere."""

    name = 'still/<b>&'

    def __len__(self):
        return 3

    def scan(self, index):
        rng = np.random.default_rng(index)
        return PointCloud(rng.uniform([-20, 9, -2], [20, 10, 3], (500, 3)).astype(np.float32))

    def T_world_lidar(self, index):
        return se3.from_xyz_rpy(x=7.0 * index)


def predictions():
    T = se3.from_xyz_rpy(x=7.0)
    answers = [T, None, se3.from_xyz_rpy(x=12.0), se3.from_xyz_rpy(x=7.3)]
    return [
        Prediction('GCL-ROS', Still.name, Pair(1, 0, 7.0, (5, 10)), 0.0, T, answer, 1.0)
        for answer in answers
    ]


def test_the_worst_come_first():
    ranked = [p.T_estimated for p in worst(predictions(), 3)]
    assert ranked[0][0, 3] == 12.0
    assert ranked[1] is None
    assert ranked[2][0, 3] == 7.3


@pytest.fixture(scope='module')
def report(tmp_path_factory):
    rows = score(predictions())
    table = published('comparison_kitti')
    figure = recall_over_distance(
        rows, lambda row: row.strict, title='a & b', published=table.curves
    )
    cases = [case(p, {Still.name: Still()}) for p in worst(predictions(), 4)]
    dots = new_figure(3, 3)
    dots.add_subplot().scatter([0, 1], [0, 1], rasterized=True)  # a picture within the SVG
    plots = [Drawing('recall <b>', svg(figure)), Drawing('dots', svg(dots))]
    parts = ['A heading', recall(rows), *plots]
    path = tmp_path_factory.mktemp('page') / 'report.html'
    path.write_text(page('Title & more', {'cpu': '<none>'}, parts, cases, [table.table]))
    return path


def test_the_page_escapes_what_it_shows(report):
    text = report.read_text()
    assert 'Title &amp; more' in text
    assert '&lt;none&gt;' in text
    assert 'still/&lt;b&gt;&amp; 1 to 0' in text
    assert 'Published (Liu et al.' in text


def test_the_page_refers_to_nothing_outside(report):
    names = {'http://www.w3.org/1999/xlink', 'http://www.w3.org/2000/svg'}  # looked up nowhere
    text = report.read_text()
    assert 'data:image/png' in text
    assert set(re.findall(r'\w+://[^"\'\s<>]+', text)) <= names
    assert not re.search(r'\bsrc=|@import|url\((?!#)|href="(?!#|data:)', text)


TOUCH = """<script>
const canvas = document.querySelector('canvas'), seen = [canvas.toDataURL()];
canvas.dispatchEvent(new PointerEvent('pointermove', {buttons: 1, movementX: 90, movementY: -90}));
seen.push(canvas.toDataURL());
canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: -300}));
seen.push(canvas.toDataURL());
canvas.parentElement.querySelectorAll('button')[1].click();
seen.push(canvas.toDataURL());
document.body.dataset.different = new Set(seen).size;
</script></body>"""


def opened(path, profile):
    """The page's document after its scripts, and what the console said."""
    flags = ['--headless', '--no-sandbox', '--disable-gpu', '--enable-logging=stderr']
    flags += [f'--user-data-dir={profile}', '--virtual-time-budget=2000']
    done = subprocess.run(
        [BROWSER, *flags, '--dump-dom', f'file://{path}'],
        capture_output=True,
        text=True,
        timeout=120,
    )
    return done.stdout, [line for line in done.stderr.splitlines() if 'CONSOLE' in line]


@pytest.mark.skipif(BROWSER is None, reason='no chromium; sh .ci/debian-packages test installs it')
def test_the_page_runs_in_a_browser(report, tmp_path):
    text = report.read_text()
    touched = report.with_name('touched.html')
    touched.write_text(text.replace('</body>', TOUCH))
    document, console = opened(touched, tmp_path)
    assert console == []  # the browser also tells of what the page's policy keeps from loading
    assert 'data-shown="4"' in document
    assert 'data-different="4"' in document  # turned, zoomed, moved to another place
    broken = report.with_name('broken.html')
    broken.write_text(text.replace('boxes.forEach(show)', 'nothing.here()'))
    assert opened(broken, tmp_path)[1]  # so that the check above can fail
