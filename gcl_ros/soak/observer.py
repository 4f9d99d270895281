"""Holds what the node says against the truth, and asks it whether it lives."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.srv import GetState
from rclpy.node import Node

from gcl_core.evaluation import metrics
from gcl_ros.conversions import matrix

ASK, PATIENCE = 5.0, 60.0  # seconds between questions, and for an answer: processors are busy
REFUSALS = ('withheld', 'left out')  # counts in the diagnostics
COUNTED = ('accepted', 'strict', 'wrong', *REFUSALS, 'answers', 'unanswered', 'not active')


class Observer(Node):
    """Listens to transforms and diagnostics, and asks for the node's state.

    Args:
        truths: T_target_source of each scene; the target stands still.
    """

    def __init__(self, truths: list[np.ndarray]) -> None:
        super().__init__('observer')
        self._truths = truths
        self.counts: Counter[str] = Counter(dict.fromkeys(COUNTED, 0))
        self.wrong: list[dict[str, Any]] = []
        self.unexplained: list[str] = []
        self.reasons: Counter[str] = Counter()
        self._refused: dict[str, int] = {}
        self._asked: tuple[float, Any] | None = None
        self._last_ask = 0.0
        self._state = self.create_client(GetState, '/registrar/get_state')
        self.create_subscription(TransformStamped, '/registrar/transform', self._transform, 10)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)

    def _transform(self, message: TransformStamped) -> None:
        """Check an accepted transform."""
        source, target = message.child_frame_id, message.header.frame_id
        number = source.rpartition('_')[2]
        T = matrix(message.transform)
        if not number.isdecimal():
            self.counts['wrong'] += 1
            self.wrong.append({'source': source, 'target': target, 'T': T.tolist()})
            return
        T_true = self._truths[int(number)]
        self.counts['accepted'] += 1
        self.counts['strict'] += metrics.registered(T, T_true, metrics.STRICT)
        if not metrics.registered(T, T_true, metrics.LOOSE):
            self.counts['wrong'] += 1
            rte, rre = metrics.rte(T, T_true), metrics.rre_deg(T, T_true)
            self.wrong.append({'source': source, 'target': target, 'rte': rte, 'rre_deg': rre})

    def _diagnosed(self, message: DiagnosticArray) -> None:
        """Check that every refusal has a reason."""
        status = message.status[0]
        figures = {value.key: value.value for value in status.values}
        self.counts['diagnostics'] += 1
        for name in REFUSALS:
            now = int(figures.get(name, 0))
            self.counts[name] = max(self.counts[name], now)
            if now > self._refused.get(name, 0):
                reason = figures.get(f'last {name}', '')
                self.reasons[f'{name}: {reason}'.split(' in frame')[0][:60]] += 1
                if not reason:
                    self.unexplained.append(f'{name}: {status.message}')
            self._refused[name] = now

    @property
    def everybody_there(self) -> bool:
        """Whether both vehicles and the node are on their topics."""
        topics = ('/source/points', '/target/points')
        return all(self.count_publishers(t) and self.count_subscribers(t) for t in topics)

    def ask(self) -> None:
        """Ask for the node's state now and then; count what is not answered in time."""
        now = time.monotonic()
        if self._asked is not None:
            asked, future = self._asked
            if future.done():
                self.counts['answers'] += 1
                if future.result().current_state.label != 'active':
                    self.counts['not active'] += 1
                self._asked = None
            elif now - asked > PATIENCE:
                self.counts['unanswered'] += 1
                self._asked = None
        elif self._state.service_is_ready() and now - self._last_ask > ASK:
            self._last_ask = now
            self._asked = now, self._state.call_async(GetState.Request())
