from cpic_planner.web.serving import application as application, serve as serve
