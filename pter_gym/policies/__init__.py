"""Trained policies, stored as data files; they run with numpy and safetensors, without torch."""

from pter_gym.policies._cards import Card
from pter_gym.policies._files import SHIPPED, exported_policies, read_policy, shipped_policies, write_policy
from pter_gym.policies._interface import Base, Input, Interface
from pter_gym.policies._network import LSTM, Network
from pter_gym.policies._neural import Net, Neural, NeuralPolicy

__all__ = [
    "LSTM",
    "SHIPPED",
    "Base",
    "Card",
    "Input",
    "Interface",
    "Net",
    "Network",
    "Neural",
    "NeuralPolicy",
    "exported_policies",
    "read_policy",
    "shipped_policies",
    "write_policy",
]
