"""What the paper prints: its claims, its misprints, and what it leaves open.  Nothing here is
computed.

Kornaev et al. 2020, Vibroengineering Procedia, DOI 10.21595/vp.2020.21549.
"""

from __future__ import annotations

from typing import Final

PAPER: Final = (
    "Kornaev et al. 2020, Machine learning for rotating machines, DOI 10.21595/vp.2020.21549"
)

SPEED: Final = (
    "the rotor dynamics simulation program with the ANN module allows calculation rotor trajectory "
    "two times faster "
    "than a real time process"
)
TRANSIENTS: Final = (
    "the ANN allows simulation of non-linear transient processes with variable rotor speed and "
    "high vibrations"
)
SIX_CLASSES: Final = "accuracy of the six classes recognition up to 90 %"
TWO_CLASSES: Final = "accuracy of the two classes recognition up to 80 % (experts up to 70 %)"
POWER: Final = "decreasing the power loss up to 17 % by the DDPG agent"

MISPRINTS: Final[tuple[tuple[str, str, str], ...]] = (
    (
        "(2)",
        "the gyroscopic term has no speed and no coupling of the two angles; no gravity; the "
        "moments of the "
        "reactions are written as dot products",
        "J_p omega couples the angles skew-symmetrically, gravity added, moments as cross products",
    ),
    ("(2)", "reactions are 'C, D'; the equations call the bearing's B", "B throughout"),
    (
        "(2)",
        "the inertia force has no term for a changing speed",
        "run-ups add alpha = d omega/dt: U (omega^2 cos + alpha sin, omega^2 sin - alpha cos)",
    ),
    (
        "(3)",
        "the signs hold for the journal as the lower surface",
        "6 omega dh/dtheta + 12 dh/dt with h = c - x cos - y sin; pure whirl at omega / 2 then "
        "gives no force",
    ),
    (
        "(3)",
        "no rule where the film ruptures: an unfed film that keeps negative pressure has no stable "
        "speed",
        "Reynolds rupture, ambient ends",
    ),
    (
        "(5)",
        "the film depends on the rotor's speed, which is not among the four inputs",
        "the network as printed holds at one speed, one viscosity and one clearance; the reduced "
        "network at any",
    ),
    (
        "(7)",
        "the softmax sum runs to n3 + 1, over the unit element too",
        "the sum runs over the classes",
    ),
    ("(8)", "the regulariser lacks its square, and so has no minimum", "theta squared, as in (6)"),
    (
        "(10)",
        "only the critic's loss is printed, as a function of both networks' weights",
        "the actor climbs the mean of q(s, mu(s)), reference [8] of the paper",
    ),
    (
        "section 4",
        "refers to the DDPG algorithm in section 2.3, which does not exist",
        "section 3 is meant",
    ),
    (
        "section 4",
        "two classes (80 %) are recognised worse than six (90 %), though two follow from six by "
        "merging",
        "both are shown; the two-class figure from the six-class network stands beside the "
        "separately trained one",
    ),
)
"""Where, what is printed, and how it is repaired here."""

OPEN: Final[tuple[str, ...]] = (
    "Layer sizes are not in the text (n2 'is arbitrary'; Fig. 4 is a drawing): all sizes here are "
    "ours.",
    "The baseline of the 17 % is not stated: ours is the constant widest clearance, beside the "
    "nominal one.",
    "The split into training and test is not stated: ours is by run (7/2/1 a class, as the "
    "authors' later public "
    "code), with the random split of windows beside it to show what it flatters.",
    "The sampling rate, the load, the viscosity law and the unbalance's radius are not stated: see "
    "the rig's file.",
    "The paper measured its second series on its rig; here the rig is simulated. No figure here is "
    "a measurement.",
)
