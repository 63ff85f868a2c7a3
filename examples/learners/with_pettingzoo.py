"""Two monitored agents of MPE2 with random actions: successes and costs.

Run: python examples/learners/with_pettingzoo.py
"""

from mpe2 import simple_spread_v3

from rtamt_gym import ParallelStlMonitor

env = ParallelStlMonitor(
    simple_spread_v3.parallel_env(N=2, max_cycles=25),
    {"apart": "always(abs(dx) + abs(dy) > 0.5)", "inside": "always(abs(x) < 1)"},
    {"dx": "agent_0: obs[8]", "dy": "agent_0: obs[9]", "x": "agent_1: obs[2]"},
    on_violation="report",
    cost="violation",
)
for agent in env.possible_agents:
    env.action_space(agent).seed(1)

successes, costs = [], []
for episode in range(40):
    observations, infos = env.reset(seed=episode)
    cost = 0.0
    while env.agents:
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        observations, rewards, terminations, truncations, infos = env.step(actions)
        cost += infos["agent_0"]["cost"]
    successes.append(infos["agent_0"]["is_success"])
    costs.append(cost)
print(f"{sum(successes)} of 40 successful, cost {sum(costs) / 40:.2f} an episode")
env.close()
