from .boards import (
    COMPLETION as COMPLETION,
    PACE_ERROR as PACE_ERROR,
    Leaderboard as Leaderboard,
    leaderboards as leaderboards,
    print_boards as print_boards,
)
from .episodes import Episodes as Episodes, training_episodes as training_episodes
from .policies import find_policy as find_policy, from_actions as from_actions, from_sb3 as from_sb3
from .results import PACES as PACES, ResultsFolder as ResultsFolder, run_scenario as run_scenario
from .rollout import (
    Assessment as Assessment,
    Episode as Episode,
    assess as assess,
    evaluate as evaluate,
    examine as examine,
    record_episode as record_episode,
)
from .scores import (
    ScenarioRun as ScenarioRun,
    Score as Score,
    WorstHand as WorstHand,
    score as score,
    score_episodes as score_episodes,
)
from .tables import write_table as write_table
from .worst_hand import find_worst as find_worst
