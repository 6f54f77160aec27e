# SPDX-License-Identifier: Apache-2.0
"""The planner's log: news in the output, the State and the Estimate of a step, each once."""

from __future__ import annotations

from rclpy.impl.rcutils_logger import RcutilsLogger

from bev_preheat.control.regime import Regime
from bev_preheat.control.state import State
from bev_preheat.control.supervisor import StepOutput
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.messages.diagnostics import heater_sentence
from bev_preheat.nodes.node import RepetitionFilter, Values
from bev_preheat.planning.planner import replaced_in_words
from bev_preheat.vehicle import Vehicle, vehicle_file
from bev_preheat.vehicle.plausibility import assumption_warning


class PlannerLog:
    """Logs the outputs of steps, and the findings in the state after them."""

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger, self._news = logger, RepetitionFilter()
        # The findings that have been logged.
        self._regime, self._signals = Regime.UNKNOWN, frozenset[str]()
        self._heater, self._resets = Heater.ANSWERS, 0

    def log_output(self, output: StepOutput) -> None:
        """Log a failure, a new status and the refusals of a step."""
        if output.failure:
            self._logger.error(output.failure)
        if output.has_new_status and output.decision is not None:
            self._logger.info(f'{output.decision.status.name}: {output.decision.explanation}')
        for refusal in output.refusals:
            sentence = f'{refusal.source} refused: {refusal.error}'
            if self._news.has(sentence):
                self._logger.error(sentence)

    def log_findings(self, state: State) -> None:
        """Log the regime, the signals in doubt and the findings of the estimation, once."""
        regime, verdicts, estimate = state.regime, state.signal_verdicts, state.estimate
        if regime.regime is not self._regime and regime.evidence:
            self._logger.info(f'Regime: {regime.regime.value}: {regime.evidence}.')
        signals = frozenset(verdict.signal for verdict in verdicts)
        for verdict in verdicts:
            if verdict.signal not in self._signals:
                self._logger.warning(f'Signal in doubt: {verdict.sentence}.')
        for signal in sorted(self._signals - signals):
            self._logger.info(f'Signal valid again: {signal}.')
        self._regime, self._signals = regime.regime, signals
        if estimate is None:
            return
        if estimate.heater.heater is not self._heater:
            self._logger.warning(f'Heater: {heater_sentence(estimate.heater)}.')
        if estimate.resets != self._resets:
            self._logger.warning(f'The estimator was reset: {estimate.reset_reason}.')
        self._heater, self._resets = estimate.heater.heater, estimate.resets

    def log_route(self, state: State) -> None:
        """Log the route that has just arrived."""
        mission = state.mission
        if mission is None:
            self._logger.info('The trip was cancelled.')
            return
        routes = [leg.route for leg in mission.legs]
        self._logger.info(
            f'Route {mission.route_id!r}: '
            f'{sum(route.total_duration_s for route in routes) / 60:.1f} min, '
            f'{sum(route.distance_m for route in routes) / 1000:.1f} km, '
            f'stops on the way: {len(routes) - 1}; propulsion power: {mission.power_source}.')
        for warning in state.inbox.unit_warnings:
            self._logger.warning(f'route_plan: {warning}.')

    def log_vehicle(self, vehicle: Vehicle, values: Values) -> None:
        """Log the assumptions of the vehicle file."""
        warning = assumption_warning(vehicle, vehicle_file(values['vehicle']))
        if warning is not None:
            self._logger.warning(f'{warning}.')

    def log_method(self, values: Values) -> None:
        """Log a method that another one has replaced."""
        if sentence := replaced_in_words(values['method']):
            self._logger.warning(f'{sentence[0].upper()}{sentence[1:]}.')
