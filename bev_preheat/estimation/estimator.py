# SPDX-License-Identifier: Apache-2.0
"""
Estimates the battery state and the corrections of the model from the battery states received.

Instants are integers, in nanoseconds of the clock that stamps the battery states.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math
from typing import NamedTuple

from bev_preheat.estimation.belief import Belief, interval_of
from bev_preheat.estimation.estimate import Estimate, LOCAL, SENSOR, SOC, TEMPERATURE
from bev_preheat.estimation.hypotheses import (
    HEALTHY,
    Heater,
    HeaterReport,
    is_suspect,
    judge,
    STUCK,
    Suspicion,
)
from bev_preheat.estimation.measured_power import PowerResponse, PowerSamples
from bev_preheat.estimation.prior import expected_offset_k, Learned, Soak
from bev_preheat.estimation.readings import Expected, MeasuredState, ReadingCheck, Verdict
from bev_preheat.numerics import array_exp, FloatArray, NS_PER_S
from bev_preheat.tunables import (
    DIVERGED_K,
    ERROR_LASTS_S,
    FAULTY,
    LEAST_INTERVAL_S,
    LONGEST_BELIEF_STEP_S,
    LONGEST_GAP_S,
    MOST_NATS,
    MOST_OTHER_POWER_W,
    READING_NOISE_K,
    READING_NOISE_SOC,
    UNHEATED_S,
)
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import DriveInputs


class DrivenInterval(NamedTuple):
    """
    The planned drive and the command for `duration_s` [s].

    `drive` is the planned DriveInputs, None if no route covers it; `command_w` is the mean
    command to the heater [W], `limit_w` the heater power left by the cabin [W]. A watt of another heat source
    heats as `hvch_watts` of the HVCH; None: it is the HVCH.
    """

    duration_s: float
    drive: DriveInputs | None
    command_w: float
    limit_w: float
    hvch_watts: float | None = None


class Estimator(NamedTuple):
    """
    The belief, and the `estimate` after the latest measurement, None before the first.

    `stamp_ns` [ns] is the instant of the latest measurement; None: the temperature is taken from the next reading
    alone. `standing` is the Soak before the next reading, and `offset_k` is subtracted from readings [K].
    `knows_power`: the battery's power of the latest step was measured. `suspect` is the Suspicion of the heater,
    None without one. `unheated_s` [s] is the time since the latest command to heat. `resets` is the number of
    resets, with the reason and instant of the last one. `direction` is 1 for a source that heats, -1 for a
    chiller. `evidence` is the log-likelihood of the measurements since any source is suspect, up to a constant
    [nats].
    """

    belief: Belief
    response: PowerResponse = PowerResponse()
    readings: ReadingCheck = ReadingCheck()
    power: PowerSamples = PowerSamples()
    knows_power: bool = False
    stamp_ns: int | None = None
    standing: Soak | None = None
    offset_k: float = 0.0
    suspect: Suspicion | None = None
    unheated_s: float = 0.0
    estimate: Estimate | None = None
    resets: int = 0
    reset_reason: str = ''
    reset_at_ns: int | None = None
    direction: int = 1
    evidence: float = 0.0

    @classmethod
    def of(cls, vehicle: Vehicle, learned: Learned | None = None, direction: int = 1) -> Estimator:
        """Return the Estimator of a vehicle file, or of earlier Learned values."""
        return cls(Belief.of(vehicle, learned), direction=direction)

    def without_instants(self) -> Estimator:
        """Return the Estimator that takes the temperature from the next reading alone."""
        return self._replace(
            stamp_ns=None, suspect=None, power=self.power.without_latest(), response=PowerResponse())

    def of_another_route(self) -> Estimator:
        """Return the Estimator without the learned consumption, because a new trip begins."""
        return self._replace(
            belief=self.belief.of_another_route(), response=self.response.of_another_route())

    def of_healthy_heater(self) -> Estimator:
        """Return the Estimator of a healthy heater, because the power with which it was compared is refuted."""
        return self if self.estimate is None else self._replace(
            belief=self.belief.of_healthy_heater(), response=PowerResponse(), suspect=None,
            estimate=replace(self.estimate, heater=HeaterReport(Heater.ANSWERS, 1.0 - FAULTY, 1.0)))

    def with_car_of(self, faulty: Estimator | None) -> Estimator:
        """
        Return the Estimator of a healthy heater if none was reported faulty: another source explains readings.

        The Estimator of that source did not take its fault for properties of the car; None: it is repaired.
        """
        if self.estimate is None or self.estimate.heater.heater is not Heater.ANSWERS:
            return self
        if faulty is None:
            return self.of_healthy_heater()
        belief = faulty.belief.of_healthy_heater()
        mean, covariance = belief.expected()
        healthy = self.of_healthy_heater()
        assert healthy.estimate is not None
        return healthy._replace(
            belief=belief, estimate=replace(healthy.estimate, mean=mean, covariance=covariance))

    def with_learned_of(self, earlier: Estimator) -> Estimator:
        """Return the Estimator with the learned values of an earlier one and the next temperature."""
        return earlier.without_instants()._replace(
            readings=self.readings, offset_k=self.offset_k, standing=self.standing)

    def after_soak(self, standing: Soak) -> Estimator:
        """Return the Estimator that takes the sensor's offset from the next reading, of a battery after a Soak."""
        return self.without_instants()._replace(standing=standing, belief=self.belief.of_stood_car())

    def restarted(self, vehicle: Vehicle, reason: str, at_ns: int) -> Estimator:
        """Return the Estimator without temperature and everything learned since the vehicle file."""
        return Estimator(Belief.of(vehicle), estimate=self.estimate, resets=self.resets + 1, reset_reason=reason,
                         reset_at_ns=at_ns, direction=self.direction, evidence=self.evidence)

    def edges_ns(self, stamp_ns: int) -> tuple[int, ...]:
        """
        Return the instants [ns] that divide the time to a measurement into one DrivenInterval each.

        () for the first measurement, after a long gap, and if the measurement comes too soon.
        """
        from_ns = self.stamp_ns
        if from_ns is None or not LEAST_INTERVAL_S <= (stamp_ns - from_ns) / NS_PER_S <= LONGEST_GAP_S:
            return ()
        steps = math.ceil((stamp_ns - from_ns) / NS_PER_S / LONGEST_BELIEF_STEP_S)
        return tuple([from_ns + (stamp_ns - from_ns) * part // steps for part in range(steps + 1)])

    def observed(self, measurement: MeasuredState, intervals: Iterable[DrivenInterval],
                 vehicle: Vehicle, others_odds: float = 0.0) -> Estimator:
        """
        Return the Estimator after a MeasuredState of a Vehicle, whose stamp is not older than the previous one.

        `intervals` are one DrivenInterval between consecutive `edges_ns(measurement.stamp_ns)`. `others_odds` are
        the `odds_of` the estimators of other heat sources: a single fault explains the readings.
        """
        state, stamp_ns = measurement.state, measurement.stamp_ns
        seen = self._replace(readings=self.readings.seen(state))
        if self.stamp_ns is None or (stamp_ns - self.stamp_ns) / NS_PER_S > LONGEST_GAP_S:
            return seen._placed(measurement, vehicle)
        readings, verdict = seen.readings.judged(measurement, self._expected_readings())
        if verdict is Verdict.JUMPED:
            return self._jumped(measurement, vehicle)
        power = self.power.seen(stamp_ns / NS_PER_S, _plausible_power_w(measurement, vehicle))
        seen = seen._replace(readings=readings, power=power)
        if (stamp_ns - self.stamp_ns) / NS_PER_S < LEAST_INTERVAL_S:
            return seen
        advanced = seen._advanced(intervals, vehicle, others_odds)
        belief = advanced.belief
        if others_odds > 0.0:
            share = min((stamp_ns - self.stamp_ns) / NS_PER_S / ERROR_LASTS_S, 1.0)
            advanced = advanced._replace(evidence=advanced.evidence + share * belief.evidence(
                state.temperature_c - self.offset_k, readings.temperature_steps.step))
        if verdict not in (Verdict.BELIEVED, Verdict.LASTING):
            return advanced._concluded(measurement, vehicle, belief, belief.expected(), others_odds=others_odds)
        if verdict is Verdict.LASTING:
            belief = belief.of_free_local_rise()
        belief, expected = belief.with_battery(
            state.temperature_c - self.offset_k, readings.temperature_steps.step, state.soc,
            readings.soc_steps.step)
        if advanced.unheated_s > UNHEATED_S:
            # A heater without a command shows only whether it is stuck on.
            belief = belief.with_odds_of(self.belief)
            expected = belief.expected()
        return advanced._concluded(measurement, vehicle, belief, expected, others_odds=others_odds)

    @property
    def fault_odds(self) -> float:
        """The probability of any fault of the heater over that of none."""
        healthy = float(self.belief.weights[HEALTHY].sum())
        return (1.0 - healthy) / healthy

    @property
    def weak_odds(self) -> float:
        """The probability that the heater is dead or derated over that it is not."""
        weak = float(self.belief.weights[HEALTHY + 1:STUCK].sum())
        return weak / (1.0 - weak)

    def odds_of(self, other: Estimator) -> float:
        """Return the probability of a fault of another source over that of none, by the evidence of both."""
        own, odds = self.fault_odds, other.fault_odds
        return math.exp(min(other.evidence - self.evidence, MOST_NATS)) * odds * (1.0 + own) / (1.0 + odds)

    def compared_anew(self) -> Estimator:
        """Return the Estimator whose evidence is that of its belief alone."""
        return self._replace(evidence=math.log1p(self.fault_odds))

    def held(self, measurement: MeasuredState, vehicle: Vehicle, command_w: float, trusts_temperature: bool = True,
             trusts_soc: bool = True) -> Estimator:
        """
        Return the Estimator after a MeasuredState that the model does not describe, without learning from it.

        The vehicle is charging, stands where its route drives, is on no leg, or a signal is in doubt; `command_w`
        is the command to its heater [W]. Hypotheses, factors, lags and the report on the heater stay. A reading
        that is not trusted is ignored.
        """
        state, stamp_ns = measurement.state, measurement.stamp_ns
        # The next step that the model describes begins here, with its own power samples.
        seen = self._replace(
            readings=self.readings.seen(state) if trusts_temperature else self.readings, suspect=None,
            power=self.power.without_latest())
        trusts_both = trusts_temperature and trusts_soc
        if self.stamp_ns is None or (stamp_ns - self.stamp_ns) / NS_PER_S > LONGEST_GAP_S:
            return seen._placed(measurement, vehicle) if trusts_both else seen
        elapsed_s = (stamp_ns - self.stamp_ns) / NS_PER_S
        if elapsed_s < LEAST_INTERVAL_S:
            return seen
        seen = seen._replace(unheated_s=0.0 if command_w > 0.0 else self.unheated_s + elapsed_s)
        is_believed = True
        if trusts_both:
            readings, verdict = seen.readings.judged(measurement, self._expected_readings())
            seen = seen._replace(readings=readings)
            if verdict is Verdict.JUMPED:
                # The car's factors stay valid: only the battery state was not followed.
                return seen._placed(measurement, vehicle)
            is_believed = verdict in (Verdict.BELIEVED, Verdict.LASTING)
        belief = self.belief.held(
            vehicle, elapsed_s, command_w,
            interval_of(state.temperature_c - self.offset_k, seen.readings.temperature_steps.step)
            if is_believed and trusts_temperature else None,
            interval_of(state.soc, seen.readings.soc_steps.step) if is_believed and trusts_soc else None)
        return seen._concluded(measurement, vehicle, belief, belief.expected(), is_held=True)

    def _expected_readings(self) -> tuple[Expected, Expected]:
        """Return the expected readings of temperature [deg C] and charge, with variances."""
        assert self.estimate is not None
        at, between = self.estimate.mean.item, self.estimate.covariance.item
        return ((at(SENSOR) + at(LOCAL) + self.offset_k,
                 between(SENSOR, SENSOR) + 2.0 * between(SENSOR, LOCAL) + between(LOCAL, LOCAL)),
                (at(SOC), between(SOC, SOC)))

    def _jumped(self, measurement: MeasuredState, vehicle: Vehicle) -> Estimator:
        """Return the Estimator that starts again from a reading that contradicts the expectation."""
        assert self.estimate is not None
        state = measurement.state
        return self.restarted(vehicle, f'battery_state jumped to {state.temperature_c:.1f} degC, '
                              f'{100 * state.soc:.1f} %: {self.estimate.temperature_c:.1f} degC, '
                              f'{100 * self.estimate.soc:.1f} % were expected', measurement.stamp_ns,
                              ).observed(measurement, (), vehicle)

    def _placed(self, measurement: MeasuredState, vehicle: Vehicle) -> Estimator:
        """Return the Estimator with temperature and charge of a reading alone."""
        state, readings = measurement.state, self.readings
        variance = readings.temperature_steps.step**2 / 12.0 + READING_NOISE_K**2
        offset_k = self.offset_k if self.standing is None else (
            expected_offset_k(self.standing, state.temperature_c, variance))
        belief = self.belief.placed(
            state.temperature_c - offset_k, variance, state.soc,
            readings.soc_steps.step**2 / 12.0 + READING_NOISE_SOC**2,
            0.0 if self.stamp_ns is None else (measurement.stamp_ns - self.stamp_ns) / NS_PER_S)
        return self._replace(
            standing=None, offset_k=offset_k, power=self.power.of_step(_plausible_power_w(measurement, vehicle)),
        )._concluded(measurement, vehicle, belief, belief.expected())

    def _advanced(self, intervals: Iterable[DrivenInterval], vehicle: Vehicle, others_odds: float) -> Estimator:
        """Return the Estimator after DrivenIntervals, before the reading at their end."""
        belief, response, power, suspect = self.belief, self.response, self.power, self.suspect
        unheated_s, evidence = self.unheated_s, self.evidence
        seen_w, variance_w2 = power.step() or (None, 0.0)
        for duration_s, drive, command_w, limit_w, hvch_watts in intervals:
            per_watt = 1.0 if hvch_watts is None else hvch_watts
            heat_w, most_heat_w = per_watt * command_w, per_watt * limit_w
            unheated_s = 0.0 if command_w > 0.0 else unheated_s + duration_s
            propulsion_w = 0.0
            if drive is None or seen_w is None:
                response = response.paused()
            else:
                heaters = belief.weights.sum(axis=1)
                heaters[HEALTHY] *= 1.0 + others_odds
                response, logs = response.seen(
                    duration_s,
                    seen_w - drive.propulsion_power_w - drive.cabin_heating_power_w - drive.auxiliary_power_w
                    - drive.heater_power_w, drive.propulsion_power_w, command_w, limit_w,
                    heaters / heaters.sum())
                if logs is not None:
                    weights = belief.weights.sum(axis=1)
                    evidence += math.log(float(weights @ array_exp(logs)))
                    belief = belief.weighed(logs.tolist())
                power, hidden_w2 = power.hidden_w2(drive.power_variance_w2, duration_s)
                heater_w = command_w if self.estimate is None else (
                    min(self.estimate.heater.share * command_w, limit_w))
                power, propulsion_w = power.mean_propulsion_w(
                    seen_w - heater_w - drive.cabin_heating_power_w - drive.auxiliary_power_w
                    - drive.heater_power_w, drive.propulsion_power_w, duration_s)
                drive = replace(
                    drive, power_variance_w2=variance_w2, terminal_power_w=seen_w, hidden_variance_w2=hidden_w2)
            suspect = self._suspected(
                suspect, belief, vehicle, duration_s, drive, heat_w, most_heat_w, hvch_watts is None)
            belief = (belief.after_unknown(duration_s) if drive is None else
                      belief.followed(
                          vehicle, duration_s, drive, heat_w, most_heat_w, propulsion_w, hvch_watts is None))
        return self._replace(belief=belief, response=response, power=power.of_next_step(), suspect=suspect,
                             unheated_s=unheated_s, evidence=evidence, knows_power=seen_w is not None)

    def _suspected(self, suspect: Suspicion | None, belief: Belief, vehicle: Vehicle, duration_s: float,
                   drive: DriveInputs | None, heat_w: float, most_heat_w: float,
                   is_hvch: bool) -> Suspicion | None:
        """Return the Suspicion after a step [s] under the source's heat, of at most `most_heat_w` [W]."""
        if suspect is None:
            return None
        step_k_per_w = vehicle.hvch.efficiency / vehicle.pack_heat_capacity_j_per_k * duration_s
        suspect = suspect._replace(
            commanded_k=suspect.commanded_k + step_k_per_w * abs(heat_w),
            uncommanded_k=suspect.uncommanded_k + step_k_per_w * max(0.0, abs(most_heat_w) - abs(heat_w)))
        if drive is None:
            return suspect
        # The warming of a battery whose heater answers.
        rate_k_per_s = belief.answering_k_per_s(vehicle, replace(
            drive, heater_power_w=drive.heater_power_w + heat_w) if is_hvch else replace(
                drive, source_heat_w=drive.source_heat_w + heat_w))
        return suspect._replace(
            explained_k=suspect.explained_k + self.direction * duration_s * rate_k_per_s,
            others_k=suspect.others_k + self.direction * step_k_per_w * (
                drive.heater_power_w + drive.source_heat_w))

    def _concluded(self, measurement: MeasuredState, vehicle: Vehicle, belief: Belief,
                   expected: tuple[FloatArray, FloatArray], is_held: bool = False,
                   others_odds: float = 0.0) -> Estimator:
        """
        Return the Estimator with the estimate after a MeasuredState, from the belief and its expected values.

        `is_held`: learning was off, so the report on the heater stays.
        """
        stamp_ns, reading_c, suspect = measurement.stamp_ns, measurement.state.temperature_c, self.suspect
        if not _is_sound(*expected):
            return self.restarted(
                vehicle, 'the estimate left its valid range', stamp_ns)._placed(measurement, vehicle)
        before = None if self.estimate is None else self.estimate.heater
        if is_held and before is not None:
            report = before
        else:
            weights: list[float] = [*map(sum, belief.weights.tolist())]
            if not is_suspect(weights):
                suspect = None
            else:
                suspect = suspect or Suspicion(since_ns=stamp_ns, from_c=reading_c)
                suspect = suspect._replace(lasts_s=(stamp_ns - suspect.since_ns) / NS_PER_S,
                                           rise_k=self.direction * (reading_c - suspect.from_c))
            others = 0.0
            if others_odds > 0.0:
                total = 1.0 + weights[HEALTHY] * others_odds
                others = weights[HEALTHY] * others_odds / total
                weights = [weight / total for weight in weights]
                weights[HEALTHY] = 1.0 - sum(weights[HEALTHY + 1:])
            report = judge(weights, before, suspect or Suspicion(),
                           self.response.support if self.knows_power else None, others)
        readings = self.readings
        return self._replace(belief=belief, stamp_ns=stamp_ns, suspect=suspect, estimate=Estimate(
            stamp_ns, *expected, report, readings.temperature_steps.step, self.resets, self.reset_reason,
            self.reset_at_ns, self.offset_k, readings.ignored_share, belief.path))


def _plausible_power_w(measurement: MeasuredState, vehicle: Vehicle) -> float | None:
    """Return the battery's power [W]; None if it is unknown or implausible."""
    power_w = measurement.power_w
    most_w = vehicle.drivetrain.maximum_power_w + vehicle.hvch.maximum_power_w + MOST_OTHER_POWER_W
    most_w += sum(source.most_w for source in vehicle.heat_sources)
    return None if power_w is None or abs(power_w) > most_w else power_w


def _is_sound(mean: FloatArray, covariance: FloatArray) -> bool:
    """Whether mean and covariance are finite and the variances plausible."""
    # Plain sums are faster than NumPy's for this few numbers. NaN and infinity propagate into a sum.
    covariances = covariance.ravel().tolist()
    variances = covariances[::len(covariance) + 1]
    return (math.isfinite(sum(mean.tolist())) and math.isfinite(sum(covariances))
            and min(variances) >= 0.0 and variances[TEMPERATURE] <= DIVERGED_K**2)
