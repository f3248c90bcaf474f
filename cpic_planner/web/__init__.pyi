from cpic_planner.web.server import application as application, serve as serve
