"""All attacks on the benchmark that tests try, by what they attack; docs/trust.md lists them."""

from collections.abc import Callable

from benchmark import (
    attacking_policies,
    test_attacks,
    test_attacks_on_names,
    test_attacks_on_reward,
    test_attacks_on_stored,
    test_episodes,
    test_gaps,
    test_identity,
    test_isolation,
    test_planning,
    test_run_files,
    test_verification,
)
from conformance import test_law_faults

ALONE: dict[str, Callable[..., None]] = {
    "a callable that repeats an identity": test_identity.test_the_score_of_another_policy_is_not_reused,
    "other weights under the same card": test_identity.test_the_score_of_another_policy_is_not_reused,
    "a controller that binds to another policy the second time": test_identity.test_what_is_judged_is_what_acts,
    "a copy as a training seed": test_run_files.test_a_copy_is_no_further_training_seed,
    "the same policy as several training seeds": (
        test_attacks_on_names.test_the_same_policy_is_no_further_training_seed
    ),
    "the same policy as several training seeds, without files": (
        test_attacks_on_names.test_copies_of_a_policy_win_nothing_where_no_file_is_kept
    ),
    "training seeds of an earlier policy of the same name": (
        test_attacks_on_names.test_training_seeds_of_an_earlier_policy_of_the_name_do_not_stay
    ),
    "a privileged planner as a training seed": (
        test_planning.test_a_privileged_planner_among_training_seeds_makes_all_of_them_privileged
    ),
    "a policy that remembers the fresh episodes of another pace": test_episodes.test_no_episode_is_drawn_twice,
    "other callables of one name on stored and fresh episodes": test_gaps.test_what_nobody_can_tell_is_not_compared,
    "a renamed file": test_run_files.test_a_renamed_file_is_left_out,
    "a broken file": test_run_files.test_a_cut_file_is_left_out,
    "a score that differs by a bit, hashed again": test_verification.test_a_score_that_nobody_gets_is_found,
    "an edited summary": test_verification.test_a_summary_that_is_edited_is_found,
    "a compiled law that returns NaN": (
        test_law_faults.test_a_number_that_is_not_finite_is_refused_and_nothing_has_moved
    ),
    "a process that hangs": test_isolation.test_one_that_hangs_takes_what_it_started_with_it,
    "a process that writes to all that is open": test_isolation.test_a_fault_in_a_decision_is_told_by_name,
}
"""Attacks that have a test for themselves."""

CORPUS: dict[str, tuple[str, ...]] = {
    "The score, by the way of riding": tuple(test_attacks.ATTACKS),
    "The reward": (*test_attacks_on_reward.ATTACKS, *test_attacks_on_reward.ON_BENDS),
    "The stored episodes; these gain there and nothing on fresh ones": tuple(test_attacks_on_stored.ATTACKS),
    "The process; these gain in process and nothing in one of their own": tuple(attacking_policies.TAMPERING),
    "The arrays that cross": tuple(attacking_policies.HARMLESS),
    "The voltages; these are refused": tuple(attacking_policies.REFUSED),
    "Planners that are told the worlds; these have no rank": tuple(test_planning.ATTACKS),
    "Names; these are refused or shown as they are": (*test_attacks_on_names.REFUSED, *test_attacks_on_names.SHOWN),
    "Files of runs, edited; these are left out": tuple(test_run_files.EDITS),
    "Files of runs, edited and hashed again; these are left out": tuple(test_run_files.SEALED),
    "What is found by running again": tuple(test_attacks_on_stored.UNSTEADY),
    "Identities, files and processes, one by one": tuple(ALONE),
}
"""Names in plain words."""
