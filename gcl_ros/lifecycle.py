"""A lifecycle node with typed parameters that starts active by itself."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from gcl_core.errors import GclError
from gcl_core.ops.memory import keep_freed_memory
from gcl_ros.parameters import Parameters
from gcl_ros.startup import running_ros
from gcl_ros.transport import unprotected

C = TypeVar('C')
REMIND = 30.0  # seconds between reminders that a misconfigured node does nothing


class ConfiguredNode(LifecycleNode, Generic[C]):
    """Subclasses `build` on configure, `begin` on activate, `end` on deactivate, then `release`.

    A node whose parameters are wrong says why, stays alive and unconfigured, and can be set right
    and configured. Parameters of which `live` says so may change at any time, the others while
    unconfigured.

    Args:
        name: of the node.
        kind: dataclass of the parameters; its field `autostart` is optional.
    """

    def __init__(self, name: str, kind: type[C], **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.config: C | None = None
        self.problem = ''
        self.parameters = Parameters(self, kind)
        self.add_on_set_parameters_callback(self._set)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)  # runs when simulated time does not
        self.create_timer(REMIND, self._remind, clock=self.steady)
        change = self._service_change_state.callback  # rclpy's; there is no public way to it
        self._service_change_state.callback = lambda *asked: self._answer_change(change, *asked)

    def build(self, config: C) -> None:
        """Load and create what is needed; a GclError says why it cannot be done."""

    def begin(self) -> None:
        """Start working."""

    def end(self) -> None:
        """Stop working; called in every state."""

    def release(self) -> None:
        """Let go of what `build` made; called in every state."""

    def live(self, name: str) -> bool:
        """Whether a parameter may change while the node is configured."""
        return False

    def changed(self, config: C) -> None:
        """Take a config in which only live parameters changed."""

    @property
    def state(self) -> str:
        """Label of the lifecycle state, such as `active`."""
        return str(self._state_machine.current_state[1])

    def start(self) -> None:
        """Configure and activate."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters and build."""
        return self._attempt(self._configure, undo=self.release)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin."""
        return self._attempt(self.begin, undo=self.end)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End."""
        return self._attempt(self.end)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go."""
        return self._attempt(self._let_go)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End and let go, from any state."""
        return self._attempt(self._let_go)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured."""
        return self._attempt(self._let_go)

    def _configure(self) -> None:
        config = self.parameters.read()
        self.build(config)
        self.config = config

    def _let_go(self) -> None:
        self.end()
        self.release()
        self.config = None

    def _answer_change(
        self,
        change: Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response],
        request: ChangeState.Request,
        response: ChangeState.Response,
    ) -> ChangeState.Response:
        """Refuse a transition that the state does not have; before Kilted nobody answers that."""
        asked = request.transition
        there = self._state_machine.available_transitions
        if any(asked.label == label if asked.label else asked.id == i for i, label, *_ in there):
            return change(request, response)
        named = f'transition {asked.label or asked.id}'
        known = ', '.join(label for _, label, *_ in there) or 'none'
        self.get_logger().error(f'no {named} from {self.state}; there is: {known}')
        response.success = False
        return response

    def _attempt(
        self, step: Callable[[], None], *, undo: Callable[[], None] | None = None
    ) -> TransitionCallbackReturn:
        """Do a step of a transition whole or not at all; rclpy would swallow what goes wrong."""
        before = [*self.publishers, *self.subscriptions]
        try:
            step()
        except GclError as error:
            self.problem = str(error)
        except Exception as error:
            self.problem = f'please report: {error!r}'
        else:
            self.problem = ''
            return TransitionCallbackReturn.SUCCESS
        if undo is not None:
            undo()
            self._destroy_all_but(before)
        self._remind()
        return TransitionCallbackReturn.FAILURE

    def _destroy_all_but(self, kept: Sequence[Any]) -> None:
        """Destroy what was created by a step that failed before anybody held it."""
        for publisher in [p for p in self.publishers if p not in kept]:
            self.destroy_publisher(publisher)
        for subscription in [s for s in self.subscriptions if s not in kept]:
            self.destroy_subscription(subscription)

    def _remind(self) -> None:
        if self.problem:
            self.get_logger().error(f'nothing will be published: {self.problem}')

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        """Accept changes that fit and may be made now."""
        changes = {p.name: p.value for p in parameters if p.name in self.parameters.defaults}
        if not changes:
            return SetParametersResult(successful=True)
        fixed = [name for name in changes if not self.live(name)]
        if self.config is not None and fixed:
            reason = f'{", ".join(fixed)} can change while unconfigured only: deactivate, clean up'
            return SetParametersResult(successful=False, reason=reason)
        try:
            config = self.parameters.read(changes)
        except GclError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.parameters.settled(changes)
        if self.config is not None:
            self.config = config
            self.changed(config)
        return SetParametersResult(successful=True)

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Set each, integers as floats where floats belong."""
        return super().set_parameters([self.parameters.fitted(p) for p in parameter_list])

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all or none, as services do; integers as floats where floats belong."""
        fitted = [self.parameters.fitted(p) for p in parameter_list]
        return super().set_parameters_atomically(fitted)

    def destroy_node(self) -> None:
        """Stop working first."""
        self.end()
        super().destroy_node()


def run(make: Callable[[], ConfiguredNode[Any]]) -> None:
    """Run a node until Ctrl-C or SIGTERM.

    The handlers are our own: rclpy's shut the context down under a node that is being built.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    keep_freed_memory(arenas=1)
    with running_ros(own_handlers=True):
        node = make()
        if lost := unprotected():
            node.get_logger().warning(lost)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        if node.get_parameter('autostart').value:
            node.start()
        else:
            node.get_logger().info('unconfigured; waiting for lifecycle transitions')
        while not stop.is_set():
            try:
                executor.spin_once(timeout_sec=0.2)
            except Exception as error:  # of a callback: the others go on
                node.get_logger().error(f'please report: {error!r}', throttle_duration_sec=5.0)
        node.destroy_node()
